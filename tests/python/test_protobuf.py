"""Protocol Buffers in programs: the property ``protobufs`` and the serializer ``proto``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hprm import _protobuf

POINT = """
    syntax = "proto3";
    message Point { int32 x = 1; string label = 2; }
"""
LINE = """
    syntax = "proto3";
    import "Point.proto";
    message Line { Point from = 1; Point to = 2; }
"""


def test_messages_are_modules_by_the_name_of_their_file(run: Any) -> None:
    outcome = run(
        """
        target Python { protobufs: [Point.proto, "Line.proto"] }
        main reactor {
          reaction(startup) {=
            import Point_pb2
            line = Line.Line(to=Point.Point(x=3, label="end"))
            print(line.to.x, line.to.label, Point_pb2 is Point)
          =}
        }
        """,
        Point_dot_proto=POINT,
        Line_dot_proto=LINE,
    )
    assert (outcome.code, outcome.out) == (0, "3 end True\n"), outcome.err


def test_messages_travel_between_federates(launch: Any) -> None:
    outcome = launch(
        """
        target Python { protobufs: Point.proto, timeout: 20 ms }
        reactor Source {
          output out
          reaction(startup) -> out {= out.set(Point.Point(x=-7, label="a")) =}
        }
        reactor Sink {
          input inp
          reaction(inp) {= print(inp.value.x, inp.value.label, type(inp.value) is Point.Point) =}
        }
        federated reactor {
          source = new Source()  sink = new Sink()
          source.out -> sink.inp after 1 ms serializer "proto"
        }
        """,
        Point_dot_proto=POINT,
    )
    assert (outcome.code, outcome.out) == (0, "[sink] -7 a True\n"), outcome.err


@pytest.mark.parametrize(
    ("proto", "message"),
    [
        ("Missing.proto", "error[LF0611]: there is no file `Missing.proto`\n --> Program.lf:1:28"),
        ("Broken.proto", "`protobufs` cannot be compiled:"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(run: Any, proto: str, message: str) -> None:
    program = f"target Python {{ protobufs: {proto} }}\nmain reactor {{}}\n"
    outcome = run(program, Broken_dot_proto="message {")
    assert outcome.code == 1
    assert message in outcome.err


def test_what_to_install_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    proto = tmp_path / "Point.proto"
    proto.write_text(POINT)
    stated = [("Point.proto", str(tmp_path / "Program.lf"))]
    assert _protobuf.messages([]) == {}
    monkeypatch.setattr(_protobuf.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr("shutil.which", lambda name: None)
    with pytest.raises(RuntimeError, match="pip install grpcio-tools"):
        _protobuf.messages(stated)


def test_only_messages_are_serialized() -> None:
    serializer = _protobuf.Serializer()
    with pytest.raises(TypeError, match="takes messages of Protocol Buffers, and this is a dict"):
        serializer.serialize({})
    with pytest.raises(RuntimeError, match="a message of type no.Such arrived"):
        serializer.deserialize(b"no.Such\0")
