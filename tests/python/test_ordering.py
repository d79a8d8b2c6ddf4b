"""Messages on paths of different length that meet again: in order, or known to be tardy."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

BENCH = Path(__file__).resolve().parents[2] / "bench" / "ordering.py"
MESSAGES = 3_000


def test_no_message_is_out_of_order_unnoticed(tmp_path: Path) -> None:
    out = tmp_path / "ordering.json"
    command = [sys.executable, str(BENCH), "--messages", str(MESSAGES), "--periods", "1,0.1"]
    command += ["--only-tagged", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = json.loads(out.read_text())["rows"]
    assert sum(row["messages"] for row in rows) == MESSAGES
    assert {row["period_ms"] for row in rows} == {1.0, 0.1}
    for row in rows:
        assert row["undetected"] == 0, row
        # A contender without a limit of time waits until every message has come.
        assert row["tardy"] == 0 or "ms" in row["contender"], row
