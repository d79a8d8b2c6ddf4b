"""Executables for tests: scripts that declare a reactor when they are asked."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

AT = [0, 1, 0, -1]

SCRIPT = """\
#!/bin/sh
if [ -n "$HPRM_DESCRIBE" ]; then
  echo asked >> {asked}
  cat {declared} > "$HPRM_DESCRIBE"
  # A text where the declaration has what to say of one.
  if grep -q '"fast"' "$HPRM_PARAMETERS"; then cat {declared}.fast > "$HPRM_DESCRIBE"; fi
  exit 0
fi
{runs}
"""


def port(name: str, kind: str = "output", width: int | None = None) -> dict[str, Any]:
    """Return a port."""
    return {"name": name, "at": AT, "kind": kind, "width": width}


def reactor(name: str, ports: list[dict[str, Any]], **members: Any) -> dict[str, Any]:
    """Return a reactor that sets its outputs at the start."""
    effects = [{"name": it["name"], "at": AT} for it in ports if it["kind"] == "output"]
    reaction = {"name": "reaction_1", "at": AT, "triggers": ["startup"], "effects": effects}
    return {"name": name, "at": AT, "ports": ports, "reactions": [reaction], **members}


def document(*reactors: dict[str, Any], **more: Any) -> str:
    """Return a declaration, whose first reactor is the main one."""
    files = [{"path": "/somewhere/camera", "text": ""}]
    return json.dumps({"files": files, "main": 0, "reactors": reactors, **more})


def write(path: Path, declared: str, runs: str = "exit 9") -> Path:
    """Write an executable that declares that, and notes beside itself how often it was asked."""
    declaration = path.with_suffix(".json")
    declaration.write_text(declared)
    asked = path.with_suffix(".asked")
    path.write_text(SCRIPT.format(declared=declaration, asked=asked, runs=runs))
    path.chmod(0o755)
    return path


def asked(path: Path) -> int:
    """Return how often an executable was asked what it declares."""
    notes = path.with_suffix(".asked")
    return notes.read_text().count("asked") if notes.exists() else 0
