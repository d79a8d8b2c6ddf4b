"""Small programs, drawn from a seed, that must do the same in every deployment.

Each is a federation of a few reactors with timers, actions, modes, banks and multiports, connected
with and without delays, in cycles too. Their reactions compute with logical time and values only,
and stick to what makes a program independent of its deployment: they send copies of what they go on
changing, and change only inputs that are mutable. A value has a number of hops left, so no cycle
sends for ever.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field

PREAMBLE = """\
preamble {=
import copy
import numpy as np

SMALL, LARGE = 3, 20_000

def make(kind, hops, number):
    "A value of a kind, from which `look` gets the hops and a number."
    if kind == "tuple": return (hops, number)
    if kind == "list": return [hops, number, [number]]
    if kind == "dict": return {"hops": hops, "number": number, "names": {str(number), "a", "b"}}
    if kind == "small": return np.array([hops, number, 1])
    if kind == "large": return np.array([hops] + [number] * LARGE)
    return hops * 1000 + number

def look(value):
    if isinstance(value, int): return value // 1000, value % 1000
    if isinstance(value, tuple): return value
    if isinstance(value, list): return value[0], (value[1] + sum(value[2])) % 997
    if isinstance(value, dict): return value["hops"], (value["number"] + len(value["names"])) % 997
    return int(value[0]), int(value[1:].sum()) % 997

def change(value):
    "Changes a value in place, if that can be done."
    if isinstance(value, list): value[2].append(value[1])
    elif isinstance(value, dict): value["names"].add("more")
    elif isinstance(value, np.ndarray): value[1:] += 1
    return value
=}
"""

KINDS = ["int", "tuple", "list", "dict", "small", "large"]
POLICIES = ["", "", ', 3 msec, "drop"', ', 3 msec, "replace"', ', 3 msec, "update"', ", 2 msec"]


@dataclass
class Class:
    """A reactor class: what its instances offer to connections."""

    name: str
    #: Widths; None for what is not a multiport.
    inputs: dict[str, int | None]
    outputs: dict[str, int | None]
    #: Whether what comes at `late` may go on at once.
    passes_late: bool = False
    lines: list[str] = field(default_factory=list)


@dataclass
class Instance:
    name: str
    of: Class
    #: How many, if it is a bank.
    bank: int | None

    def channels(self, width: int | None) -> int:
        """Count the channels of one of its ports."""
        return (self.bank or 1) * (width or 1)


def program(seed: int, name: str) -> str:
    """Return the text of a program whose main reactor has that name."""
    return _Draw(random.Random(seed)).program(name)


class _Draw:
    def __init__(self, rng: random.Random) -> None:
        self.rng = rng
        self.ending = rng.choice(["timeout", "timeout", "stop", "stop", "starve"])

    def maybe(self, probability: float) -> bool:
        return self.rng.random() < probability

    def program(self, name: str) -> str:
        classes = [self.reactor(f"R{number}") for number in range(self.rng.randint(2, 3))]
        instances = [
            Instance(f"i{number}", of, self.rng.choice([None, None, None, 2]))
            for number, of in enumerate(self.rng.choices(classes, k=self.rng.randint(2, 3)))
        ]
        used = [of for of in classes if any(instance.of is of for instance in instances)]
        timeout = {"timeout": "timeout: 25 ms", "stop": "timeout: 60 ms", "starve": ""}[self.ending]
        word = "federated" if self.maybe(0.9) else "main"
        lines = [f"target Python {{ {timeout} }}", PREAMBLE.rstrip()]
        for of in used:
            lines += of.lines
        lines.append(f"{word} reactor {name} {{")
        for instance in instances:
            bank = "" if instance.bank is None else f"[{instance.bank}]"
            lines.append(f"  {instance.name} = new{bank} {instance.of.name}()")
        lines += [f"  {connection}" for connection in self.connections(instances)]
        return "\n".join([*lines, "}", ""])

    # Reactors.

    def reactor(self, name: str) -> Class:
        width = self.rng.choice([None, None, 2])
        inputs: dict[str, int | None] = {"inp": width, "late": None, "idle": None}
        outputs: dict[str, int | None] = {"out": None, "wide": self.rng.choice([None, 2])}
        of = Class(name, inputs, outputs)
        mutable = "mutable " if width is None and self.maybe(0.3) else ""
        of.lines += [
            f"reactor {name} {{",
            f"  {mutable}input{self.width(width)} inp",
            "  input late",
            "  input idle",
            "  output out",
            f"  output{self.width(outputs['wide'])} wide",
            f"  timer t({self.rng.randint(0, 4)} ms{self.period()})",
            f"  logical action a({self.rng.randint(0, 4)} ms{self.rng.choice(POLICIES)})",
            "  state n = 0",
            "  state seen = 0",
            f'  state kept = {{= make("{self.rng.choice(KINDS)}", 2, 7) =}}',
        ]
        if self.maybe(0.3):
            of.lines += self.modes(of)
        of.lines += self.reactions(of, bool(mutable))
        of.lines += ["}"]
        return of

    def width(self, width: int | None) -> str:
        return "" if width is None else f"[{width}]"

    def period(self) -> str:
        return "" if self.ending == "starve" else f", {self.rng.randint(2, 9)} ms"

    def modes(self, of: Class) -> list[str]:
        """Two modes with a timer each, which alternate."""
        lines = []
        for mode, other, first in [("X", "Y", "initial "), ("Y", "X", "")]:
            how = self.rng.choice(["reset", "history"])
            period = self.rng.randint(1, 6)
            repeat = "" if self.ending == "starve" else f", {period} ms"
            lines += [
                f"  {first}mode {mode} {{",
                f"    timer m{mode}({self.rng.randint(0, 3)} ms{repeat})",
                f"    reaction(m{mode}) -> wide, {how}({other}) {{=",
                "      self.n += 1",
                *(f"      {line}" for line in self.set(of, "wide", "self.n % 997")),
                f"      if self.n % {self.rng.randint(1, 3)} == 0 and self.n < 40: {other}.set()",
                "    =}",
                "  }",
            ]
        return lines

    def reactions(self, of: Class, mutable: bool) -> list[str]:
        """The reactions outside of modes."""
        persists = self.maybe(0.2)
        of.passes_late = persists or self.maybe(0.4)
        first = f"late.set({self.value('0', 'self.bank_index')})"
        lines = [f"  reaction(startup) late {{= {first} =}}"] if persists else []
        lines += [
            "  reaction(t) -> out, a {=",
            "    self.n += 1",
            *(f"    {line}" for line in self.ticks(of)),
            "  =}",
            "  reaction(a) -> out, wide {=",
            "    hops, number = look(a.value)",
            "    self.seen = (self.seen + number) % 997",
            *(f"    {line}" for line in self.set(of, "out", "self.seen", "hops")),
            *(f"    {line}" for line in self.set(of, "wide", "number", "hops")),
            "  =}",
        ]
        sources = " late" if of.passes_late else ""
        lines += [
            f"  reaction(inp){sources} -> wide, a {{=",
            *(f"    {line}" for line in self.takes(of, mutable)),
            *(
                ["    if late.value is not None: self.seen += look(late.value)[1]"]
                if sources
                else []
            ),
            *(f"    {line}" for line in self.set(of, "wide", "self.seen % 997", "hops")),
            "    if hops > 0 and self.seen % 2 == 0: "
            + self.schedule(self.value("hops - 1", "self.seen % 997")),
            f"  =}}{self.deadline()}",
        ]
        if self.maybe(0.5):
            lines += ["  reaction(shutdown) -> out {=", "    out.set(self.seen)", "  =}"]
        # The last reaction sets nothing, so its input may be in a cycle without a delay.
        lines += [
            "  reaction(late) -> a {=",
            "    self.seen = (self.seen + look(late.value)[1]) % 997",
            f"    if look(late.value)[0] > 0: {self.schedule(self.value('0', 'self.seen'))}",
            "  =}",
        ]
        return lines

    def ticks(self, of: Class) -> list[str]:
        lines = self.set(of, "out", "self.n % 997")
        if self.maybe(0.5):
            lines += ["change(self.kept)", "out.set(copy.deepcopy(self.kept))"]
        if self.maybe(0.6):
            every = self.rng.randint(1, 3)
            lines += [f"if self.n % {every} == 0: {self.schedule(self.value())}"]
        if self.maybe(0.1):
            lines += [f"if self.n == {self.rng.randint(1, 4)}: lf.stop()"]
        if self.ending == "stop" and self.maybe(0.7):
            lines += [f"if self.n == {self.rng.randint(2, 5)}: request_stop()"]
            if self.maybe(0.5):
                lines += [self.schedule(self.value())]
        return lines

    def takes(self, of: Class, mutable: bool) -> list[str]:
        """Read the input `inp`, and have `hops` and `self.seen`."""
        if of.inputs["inp"] is not None:
            return [
                "hops = 0",
                "for port in inp:",
                "    if port.is_present:",
                "        more, number = look(port.value)",
                "        hops, self.seen = max(hops, more), (self.seen * 3 + number) % 997",
            ]
        value = "change(inp.value)" if mutable else "inp.value"
        keeps = ["self.kept = copy.deepcopy(inp.value)"] if self.maybe(0.3) else []
        return [f"hops, number = look({value})", *keeps, "self.seen = (self.seen + number) % 997"]

    def set(self, of: Class, port: str, number: str, hops: str = "3") -> list[str]:
        """Set an output, perhaps not always."""
        value = self.value(f"{hops} - 1", number)
        width = of.outputs[port]
        condition = f"if {hops} > 0 and self.n % {self.rng.randint(1, 2)} == 0: "
        if width is None:
            return [f"{condition}{port}.set({value})"]
        return [f"{condition}{port}[self.n % {width}].set({value})"]

    def value(self, hops: str = "2", number: str = "self.n % 997") -> str:
        return f'make("{self.rng.choice(KINDS)}", {hops}, {number})'

    def schedule(self, value: str) -> str:
        offset = self.rng.choice(["0", "0", "MSEC(1)", "MSEC(3)", "USEC(500)", "MSEC(50)"])
        return f"a.schedule({offset}, {value})"

    def deadline(self) -> str:
        return " deadline(60 sec) {= raise SystemExit(1) =}" if self.maybe(0.3) else ""

    # Connections.

    def connections(self, instances: list[Instance]) -> list[str]:
        """Connect what fits. A cycle has a delay, or ends in a reaction that sets nothing."""
        lines = []
        for place, instance in enumerate(instances):
            for port, width in instance.of.inputs.items():
                if self.maybe(0.7 if port == "idle" else 0.15):
                    continue
                sources = [
                    (number, other, out)
                    for number, other in enumerate(instances)
                    for out in other.of.outputs
                    if other is not instance or port == "inp"
                ]
                self.rng.shuffle(sources)
                for number, other, out in sources:
                    line = self.connect(
                        (other, out), (instance, port, width), forward=number < place
                    )
                    if line is not None:
                        lines.append(line)
                        break
        return lines

    def connect(
        self,
        source: tuple[Instance, str],
        target: tuple[Instance, str, int | None],
        *,
        forward: bool,
    ) -> str | None:
        (other, out), (instance, port, width) = source, target
        available = other.channels(other.of.outputs[out])
        needed = instance.channels(width)
        left = f"{other.name}.{out}"
        if available != needed:
            if available != 1:
                return None
            left = f"({left})+"
        delays = ["", "", " after 0", " after 1 ms", " after 4 ms", " after 30 ms"]
        circular = not forward and port != "idle"
        if circular and (port == "inp" or instance.of.passes_late):
            delays = delays[2:]
        return f"{left} -> {instance.name}.{port}{self.rng.choice(delays)}"
