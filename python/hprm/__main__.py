"""``python -m hprm``: running a program, or one federate of it, in this interpreter.

The command ``hprm`` starts these; it does more for a person.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys

from hprm import _debugging, _hprm, _mistakes, _startup, _threads
from hprm._ending import AFTER_FAILURE, leave
from hprm._lf import FEDERATION_ID

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any, NoReturn


def main() -> NoReturn:
    """Run what the command line says, and leave with its exit code."""
    _startup.done()
    parser = _parser()
    options = parser.parse_args()
    _startup.collect_garbage()
    parent = getattr(options, "die_with_parent", None)
    if parent is not None and not _hprm.die_with_parent(parent):
        leave(1)
    # Programs that this one starts are none of the launcher's.
    os.environ.pop(_hprm.read_descriptions(), None)
    if options.command == "syntax":
        from hprm import _syntax

        _syntax.report(options.files)
        leave(0)
    if options.command == "view":
        from hprm import _viewing

        leave(_viewing.view(options))
    if options.command == "mirror":
        from hprm import _mirroring

        leave(_mirroring.mirror(options))
    if options.command == "bag":
        from hprm.ros._bags import command

        leave(command.run(options))
    if options.json:
        _hprm.tell_programs()
    has_warned = os.environ.pop(_mistakes.WARNED, None) is not None
    _mistakes.is_quiet = has_warned or getattr(options, "launched", False)
    if options.command == "declare":
        leave(_declare(options))
    arguments = options.arguments[1:] if options.arguments[:1] == ["--"] else options.arguments
    sys.argv = [options.file, *arguments]
    _threads.let_bodies_start_threads()
    if options.command == "federate" or options.in_process:
        _debugging.explain_breakpoints(getattr(options, "federate", ""))
    if options.command == "run" and options.in_process:
        code = _hprm.run_in_process(
            options.file,
            options.property,
            logical_traces=options.logical_trace,
            share_of=options.share_of,
            join_timeout=options.join_timeout,
            hang_timeout=options.hang_timeout,
        )
    elif options.command == "run":
        launch = None if options.launcher is None else lambda: _launch(options, arguments)
        code = _hprm.run_program(
            options.file, options.property, logical_trace=options.logical_trace, launch=launch
        )
    else:
        if not options.federation:
            parser.error("the secret of the federation is missing: --federation ID")
        for stream in (sys.stdout, sys.stderr):
            stream.reconfigure(line_buffering=True)  # type: ignore[union-attr]
        # For `lf.get_federation_id`, and for federates that this one starts.
        os.environ |= {FEDERATION_ID: options.federation, "HPRM_RTI": options.rti}
        code = _hprm.run_federate(
            options.file,
            options.federate,
            {
                "rti": options.rti,
                "federation": options.federation,
                "connect_timeout": 0.0 if _is_beside(options) else options.connect_timeout,
                "advertise": options.advertise,
                "tls": _tls(parser, options),
                "launched": options.launched,
                "logical_trace": options.logical_trace,
                "share_of": options.share_of,
                "properties": options.property,
            },
        )
    # A federate that has failed does not delay the end of its federation.
    alone = options.command == "run" and not options.in_process
    leave(code, patience=None if alone or code == 0 else AFTER_FAILURE)


def _is_beside(options: argparse.Namespace) -> bool:
    """Whether a launcher has started this federate where all others are: its RTI is there.

    Agents, which lead links to other machines, may need a while, and be started again.
    """
    is_led = options.rti.startswith("agent:") or options.advertise == "agent:"
    return options.launched and not is_led


def _launch(options: argparse.Namespace, arguments: list[str]) -> int:
    """Have the command run the program, which is a federation. Return the exit code."""
    from hprm import _launching

    words = [f"--property={it}" for it in options.property]
    if options.logical_trace is not None:
        words += ["--logical-trace", options.logical_trace]
    if options.trace is not None:
        words += ["--trace", options.trace, "--trace-buffer", options.trace_buffer]
    if options.json:
        words.append("--json")
    return _launching.launch(options.launcher, [*words, options.file, "--", *arguments])


def _declare(options: argparse.Namespace) -> int:
    """Write the structure of a program of Python objects to a file, or what is wrong with it.

    Return the exit code.
    """
    sys.argv = [options.file, *options.arguments]
    try:
        from hprm import _loading

        declared = _loading.load(options.file, options.property)
        code, lines = 0, [declared.text]
    except BaseException as error:
        code, lines = _hprm.loading_failed(error, options.file)
        if code == 0:
            # It has shown its help, for example.
            lines = ["null"]
    with open(options.out, "w", encoding="utf-8") as file:
        file.write("\n".join(lines))
    return code


def _tls(
    parser: argparse.ArgumentParser, options: argparse.Namespace
) -> tuple[str, str, str] | None:
    files = (options.tls_cert, options.tls_key, options.tls_ca)
    if any(files) and not all(files):
        parser.error("TLS needs all of --tls-cert, --tls-key and --tls-ca")
    return files if all(files) else None


def _formatter(prog: str) -> argparse.HelpFormatter:
    """Format help for 80 columns: finding out how many there are takes longer than all options."""
    return argparse.HelpFormatter(prog, width=78)


class _Parser(argparse.ArgumentParser):
    """A parser that is made quickly, as its subparsers are: each process of a program makes one."""

    def __init__(self, **options: Any) -> None:
        super().__init__(formatter_class=_formatter, **options)


def _add_watching(commands: Any) -> None:
    """Add the commands that watch a running federation."""
    view = commands.add_parser("view", help="show what a running federation sends in Foxglove")
    view.add_argument("--host", default="127.0.0.1", help="where to listen for viewers")
    view.add_argument("--port", type=int, default=8765, help="the port; 0 for any")
    view.add_argument("--of", metavar="FEDERATION", help="the federation, if several run")
    view.add_argument(
        "--wait", type=int, default=0, metavar="NANOSECONDS", help="how long to wait for it"
    )
    view.add_argument("ports", nargs="*", help="federates and their ports; all if there are none")
    mirror = commands.add_parser("mirror", help="send what passes a connection to a key of Zenoh")
    mirror.add_argument("--of", metavar="FEDERATION", help="the federation, if several run")
    mirror.add_argument(
        "--wait", type=int, default=0, metavar="NANOSECONDS", help="how long to wait for it"
    )
    mirror.add_argument("--key", help="the key")
    mirror.add_argument("--topic", metavar="NAME", help="a topic of ROS 2 instead")
    mirror.add_argument("--as", dest="form", choices=["raw", "json", "cdr"], default="raw")
    mirror.add_argument("--type", help="the type of messages, as std_msgs/msg/String")
    mirror.add_argument("--zenoh", metavar="ENDPOINT", required=True, help="where the router is")
    mirror.add_argument("--domain-id", metavar="NUMBER", help="the domain of the topic")
    mirror.add_argument("port", metavar="FED.PORT", help="a federate and its port")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="python -m hprm", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run", help="run a program in this process")
    run.add_argument(
        "--in-process",
        action="store_true",
        help="give each federate a thread; the logical trace is a folder then",
    )
    run.add_argument(
        "--join-timeout",
        type=float,
        metavar="SECONDS",
        help="how long federates that are threads may take until all are loaded",
    )
    run.add_argument(
        "--hang-timeout",
        type=float,
        metavar="SECONDS",
        help="with --in-process: fail if a federate does not answer for so long",
    )
    run.add_argument(
        "--launcher", metavar="PATH", help="the command that runs the program if it is a federation"
    )
    run.add_argument("--trace", metavar="FILE", help="for the launcher")
    run.add_argument("--trace-buffer", metavar="RECORDS", help="for the launcher")
    run.add_argument("file", help="the .lf file")
    run.add_argument("arguments", nargs=argparse.REMAINDER, help="for the program, in sys.argv")
    declare = commands.add_parser(
        "declare", help="write the structure of a program of Python objects"
    )
    declare.add_argument("--out", required=True, metavar="FILE", help="the file that gets it")
    declare.set_defaults(json=False)
    declare.add_argument(
        "--property", action="append", default=[], help="a target property: KEY=VALUE"
    )
    declare.add_argument("file", help="FILE.py or FILE.py:NAME")
    declare.add_argument("arguments", nargs=argparse.REMAINDER, help="for the program, in sys.argv")
    syntax = commands.add_parser("syntax", help="find mistakes in the Python of programs")
    syntax.add_argument("files", nargs="+", help="the .lf files")
    _add_watching(commands)
    bag = commands.add_parser("bag", help="look at bags of ROS 2, and convert them")
    of_bags = bag.add_subparsers(dest="bag", required=True)
    info = of_bags.add_parser("info", help="say what is in bags")
    info.add_argument("--json", action="store_true", help="print one JSON object a line")
    info.add_argument("paths", nargs="+", help="bags")
    convert = of_bags.add_parser("convert", help="write a copy of a bag in the other format")
    convert.add_argument("--storage", choices=["mcap", "sqlite3"], help="the format of the copy")
    convert.add_argument("source", help="the bag")
    convert.add_argument("destination", help="the copy")
    federate = commands.add_parser("federate", help="run one federate of a program")
    for command in (run, federate):
        command.add_argument("--logical-trace", metavar="FILE", help="write what reactions do")
        command.add_argument(
            "--share-of", metavar="FILE", help="the trace that is made of what federates write"
        )
    federate.add_argument("file", help="the .lf file")
    federate.add_argument("federate", help="the name of the federate")
    federate.add_argument("--rti", required=True, help="the address of the RTI")
    federate.add_argument(
        "--federation",
        default=os.environ.get(FEDERATION_ID),
        help="the secret of the federation; better in HPRM_FEDERATION_ID, which is private",
    )
    federate.add_argument(
        "--connect-timeout",
        type=float,
        default=60.0,
        metavar="SECONDS",
        help="how long the RTI may take to be there",
    )
    federate.add_argument(
        "--advertise", metavar="HOST[:PORT]", help="by which other machines reach this one"
    )
    for name, what in [("cert", "certificate"), ("key", "key"), ("ca", "authorities")]:
        federate.add_argument(f"--tls-{name}", metavar="FILE", help=f"the {what}, in PEM")
    federate.add_argument(
        "--launched", action="store_true", help="a launcher shows warnings and failures"
    )
    for command in (run, federate):
        command.add_argument(
            "--die-with-parent",
            type=int,
            metavar="PID",
            help="never outlive the caller, which is PID",
        )
        command.add_argument("--json", action="store_true", help="print failures as JSON")
        command.add_argument(
            "--property", action="append", default=[], help="a target property: KEY=VALUE"
        )
    federate.add_argument("arguments", nargs="*", help="for the program, in sys.argv, after --")
    return parser


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        # Of several Ctrl-C in a row, the last may come when all is over.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        leave(130, patience=0.0)
