"""Time zones of pytz, which pandas used before Python had its own."""

from typing import Any

from hprm._kinds import Parts


def zone(name: str, *offsets: Any) -> Any:
    """Find a zone, or what it is at some time."""
    import pytz

    return pytz.UTC if name == "UTC" else pytz.tzinfo.unpickler(name, *offsets)


def taker(kind: type) -> Any:
    """Return what takes apart zones."""
    known = "BaseTzInfo" in [base.__name__ for base in kind.__mro__]
    return _take_zone if known else None


def _take_zone(value: Any) -> Parts:
    _, arguments = value.__reduce__()
    return zone, arguments or ("UTC",)
