"""``python -m hprm.ros``: running programs of rclpy, one or several. ``hprm ros`` starts these."""

from __future__ import annotations

import argparse
import atexit
import importlib
import os
import runpy
import signal
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

from hprm import _startup
from hprm.ros import (
    _aliases,
    _meeting,
    _process,
    _runtime,
    _sleeping,
    _turns,
    _user_modules,
    _words,
)
from hprm.ros._messages.packages import note_called
from hprm.ros.exceptions import ROSInterruptException
from hprm.ros.executors import ExternalShutdownException

#: Where the scripts are that are HPRM's own: they play and record bags.
_OWN_PROGRAMS = Path(__file__).with_name("_bags")

#: What ends a script that waits.
_ENDS = (KeyboardInterrupt, ExternalShutdownException)
_ENDS_OF_THREADS = (ROSInterruptException, ExternalShutdownException)


def main() -> int:
    """Do what the command line says, and return the exit code."""
    # Ctrl-C ends the process until a program has begun: nothing is there to be ended in order.
    _startup.loaded()
    options = _parser().parse_args()
    _startup.collect_garbage()
    if options.command == "call":
        return _call(options)
    if options.command == "stubs":
        from hprm.ros._stubs import write

        print(f"{write(Path(options.folder), options.program)} stubs in {options.folder}")
        return 0
    if options.start_time is not None:
        os.environ[_runtime.START_TIME] = str(round(options.start_time * 1e9))
    settings = None
    if options.zenoh is not None:
        if options.fast:
            print("error: --fast does not go together with --zenoh", file=sys.stderr)
            return 1
        from hprm.ros._zenoh.session import BridgeError, Settings

        try:
            wanted, wait = options.zenoh_only, options.zenoh_align_stamp
            settings = Settings.of(options.zenoh, options.domain_id, wanted, wait)
        except BridgeError as error:
            print(f"error: {error}", file=sys.stderr)
            return 1
    if options.command == "launch" or _meeting.COORDINATOR not in os.environ:
        os.environ[_meeting.LAUNCH] = os.urandom(8).hex()
    if options.command == "launch":
        from hprm.ros._launching import launch as start

        return start(options, settings)
    programs = _words.programs(options.words)
    wrong = _words.errors(programs)
    for text in wrong:
        print(f"error: {text}", file=sys.stderr)
    if wrong:
        return 1
    if _meeting.COORDINATOR not in os.environ:
        # In the processes of the scripts it has been said.
        for text in _words.warnings(programs):
            print(text, file=sys.stderr)
    if len(programs) == 1 and settings is None and options.logical_trace is None:
        if options.fast:
            os.environ[_meeting.FAST] = "1"
        return _run(*programs[0])
    from hprm.ros._coordinator import coordinate
    from hprm.ros._members import Plan

    plans = [Plan.of_script(path, arguments) for path, *arguments in programs]
    plans[0] = replace(plans[0], has_input=True)
    return coordinate(plans, settings, options.logical_trace, is_fast=options.fast)


def _parser() -> argparse.ArgumentParser:
    """What can be typed."""
    parser = argparse.ArgumentParser(prog="python -m hprm.ros", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    # What a script takes may begin like an option of HPRM.
    whole: Any = {"allow_abbrev": False}
    run = commands.add_parser("run", help="run scripts that import rclpy", **whole)
    _add_options(run)
    run.add_argument("words", nargs=argparse.REMAINDER, help="a script with arguments, + another")
    launch = commands.add_parser("launch", help="start what a launch file asks for", **whole)
    _add_options(launch)
    launch.add_argument("--show-args", action="store_true", help="show its arguments")
    launch.add_argument("--print-description", action="store_true", help="show its actions")
    launch.add_argument("file", help="a launch file in Python, XML or YAML")
    launch.add_argument("arguments", nargs="*", help="NAME:=VALUE")
    call = commands.add_parser("call", help="call a function, as an entry point does", **whole)
    call.add_argument("root", help="the folder from which its module is imported")
    call.add_argument("module", help="the module")
    call.add_argument("function", help="the function")
    call.add_argument("arguments", nargs=argparse.REMAINDER, help="for the program")
    stubs = commands.add_parser("stubs", help="write stubs of rclpy and messages for editors")
    stubs.add_argument("folder", help="where: typings, for Pyright")
    stubs.add_argument("program", nargs="?", help="beside which there are packages of messages")
    return parser


def _add_options(parser: argparse.ArgumentParser) -> None:
    """Say what can be typed of the trace, and of the bridge to nodes elsewhere."""
    parser.add_argument("--logical-trace", metavar="FILE", help="write the logical trace here")
    parser.add_argument(
        "--start-time", metavar="SECONDS", type=float, help="what clocks show first"
    )
    parser.add_argument("--fast", action="store_true", help="do not wait for physical time")
    parser.add_argument("--zenoh", metavar="ENDPOINT", help="bridge to ROS 2 over this router")
    parser.add_argument("--domain-id", help="the domain of ROS 2")
    parser.add_argument("--zenoh-align-stamp", metavar="SECONDS", type=float)
    parser.add_argument("--zenoh-only", metavar="NAME", action="append", default=[])


def _run(script: str, *arguments: str) -> int:
    """Run a script as Python does."""
    sys.argv = [script, *arguments]
    sys.path[0] = os.path.dirname(os.path.abspath(script))
    _user_modules.install(Path(script))
    if Path(script).parent == _OWN_PROGRAMS:
        # What it imports belongs to the start of the process, in which Ctrl-C is quiet.
        importlib.import_module(f"hprm.ros._bags.{Path(script).stem}")
    return _program(lambda: runpy.run_path(script, run_name="__main__"))


def _call(options: argparse.Namespace) -> int:
    """Call the function of an entry point, as the script does that pip makes of it."""
    sys.argv = [options.function, *options.arguments]
    sys.path[0] = options.root
    # Any file of the package, around which others are.
    beside = Path(options.root, "setup.py")
    _user_modules.install(beside)
    note_called(str(beside))

    def call() -> object:
        found: Any = importlib.import_module(options.module)
        for name in options.function.split("."):
            found = getattr(found, name)
        # What the function returns is the exit code, or a text for the standard error.
        return sys.exit(found())

    return _program(call)


def _program(run: Callable[[], object]) -> int:
    """Run a program to its end."""
    _startup.done()
    _aliases.install()
    _sleeping.install()
    sys.excepthook = _show
    threading.excepthook = _show_of_thread
    try:
        run()
    except ExternalShutdownException:
        if not _process.is_stranded():
            raise
        # What has ended the other scripts' federation is told where it has happened.
        return 1
    except KeyboardInterrupt as error:
        _show(type(error), error, error.__traceback__)
        # As Python ends a script, but not a module.
        threading._shutdown()  # type: ignore[attr-defined]
        atexit._run_exitfuncs()
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGINT)
    return 0


def _show(kind: type[BaseException], error: BaseException, traceback: TracebackType | None) -> None:
    """Show an exception as Python does, without what has started the script.

    What ends a script that waits in rclpy is shown where the script does so.
    """
    while traceback is not None and _is_start(traceback.tb_frame):
        traceback = traceback.tb_next
    if isinstance(error, _ENDS):
        _cut(traceback)
    context = error.__context__
    while context is not None:
        if isinstance(context, _ENDS):
            _cut(context.__traceback__)
        context = context.__context__
    sys.__excepthook__(kind, error.with_traceback(traceback), traceback)


_show_of_any_thread = threading.excepthook


def _show_of_thread(args: threading.ExceptHookArgs) -> None:
    """Show what has ended a thread, unless that is the end of the federation by another script."""
    if not (issubclass(args.exc_type, _ENDS_OF_THREADS) and _process.is_stranded()):
        _show_of_any_thread(args)


def _cut(traceback: TracebackType | None) -> None:
    """Take away what the package, and Python for it, does behind the last line of the script."""
    last, each = None, traceback
    while each is not None:
        path = each.tb_frame.f_code.co_filename
        # What modules of Python generate, as dataclasses do, has no file.
        if not path.startswith((*_turns.NOT_OF_SCRIPTS, "<")):
            last = each
        each = each.tb_next
    if last is not None:
        last.tb_next = None


def _is_start(frame: FrameType) -> bool:
    path = frame.f_code.co_filename
    return path == __file__ or path.startswith("<frozen ") or path == runpy.__file__


if __name__ == "__main__":
    sys.exit(main())
