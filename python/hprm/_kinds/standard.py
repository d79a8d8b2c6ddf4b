"""Values of Python's own library."""

from __future__ import annotations

import array
import datetime
import decimal
import fractions
import pathlib
import uuid
import zoneinfo
from pickle import PickleBuffer
from typing import Any

from hprm._kinds import Parts, buffers

_PATHS = (pathlib.PosixPath, pathlib.PurePosixPath, pathlib.PureWindowsPath)


def text(data: bytes) -> str:
    """Make a string that has no UTF-8."""
    return data.decode("utf-8", "surrogatepass")


def decimal_(text: str) -> decimal.Decimal:
    """Make a decimal number."""
    return decimal.Decimal(text)


def fraction(numerator: int, denominator: int) -> fractions.Fraction:
    """Make a fraction."""
    return fractions.Fraction(numerator, denominator)


def datetime_(*fields: Any) -> datetime.datetime:
    """Make a point in time."""
    *parts, fold = fields
    return datetime.datetime(*parts, fold=fold)


def date(year: int, month: int, day: int) -> datetime.date:
    """Make a date."""
    return datetime.date(year, month, day)


def time(*fields: Any) -> datetime.time:
    """Make a time of day."""
    *parts, fold = fields
    return datetime.time(*parts, fold=fold)


def timedelta(days: int, seconds: int, microseconds: int) -> datetime.timedelta:
    """Make a duration."""
    return datetime.timedelta(days, seconds, microseconds)


def timezone(offset: datetime.timedelta, name: str | None) -> datetime.timezone:
    """Make a fixed offset from UTC."""
    if name is None:
        return datetime.timezone(offset)
    return datetime.timezone(offset, name)


def zone(key: str) -> zoneinfo.ZoneInfo:
    """Find a zone in this machine's data."""
    return zoneinfo.ZoneInfo(key)


def uuid_(data: bytes, safe: int | None) -> uuid.UUID:
    """Make a UUID."""
    return uuid.UUID(bytes=data, is_safe=uuid.SafeUUID(safe))


def path(flavour: int, text: str) -> pathlib.PurePath:
    """Make a path."""
    return _PATHS[flavour](text)


def range_(start: int, stop: int, step: int) -> range:
    """Make a range."""
    return range(start, stop, step)


def slice_(start: Any, stop: Any, step: Any) -> slice:
    """Make a slice."""
    return slice(start, stop, step)


def ellipsis_(what: int) -> Any:
    """Find a constant."""
    return (..., NotImplemented)[what]


def array_(typecode: str, itemsize: int, data: memoryview) -> array.array[Any]:
    """Make an array of numbers."""
    made: array.array[Any] = array.array(typecode)
    if made.itemsize != itemsize:
        raise ValueError(f"an array of type {typecode!r} has other elements on the other machine")
    made.frombytes(data)
    return made


def _text(value: str) -> Parts:
    return text, (value.encode("utf-8", "surrogatepass"),)


def _datetime(value: datetime.datetime) -> Parts:
    numbers = value.year, value.month, value.day, value.hour, value.minute, value.second
    return datetime_, (*numbers, value.microsecond, value.tzinfo, value.fold)


def _time(value: datetime.time) -> Parts:
    numbers = value.hour, value.minute, value.second, value.microsecond
    return time, (*numbers, value.tzinfo, value.fold)


def _timezone(value: datetime.timezone) -> Parts:
    offset, *name = value.__getinitargs__()  # type: ignore[attr-defined]
    return timezone, (offset, name[0] if name else None)


def _zone(value: zoneinfo.ZoneInfo) -> Parts | None:
    # One without a key was made from a file.
    return None if value.key is None else (zone, (value.key,))


def _array(value: array.array[Any]) -> Parts:
    data = memoryview(value).cast("B") if len(value) else b""
    return array_, (value.typecode, value.itemsize, PickleBuffer(data))


TAKERS: dict[type, Any] = {
    str: _text,
    decimal.Decimal: lambda value: (decimal_, (str(value),)),
    fractions.Fraction: lambda value: (fraction, (value.numerator, value.denominator)),
    datetime.datetime: _datetime,
    datetime.date: lambda value: (date, (value.year, value.month, value.day)),
    datetime.time: _time,
    datetime.timedelta: lambda value: (timedelta, (value.days, value.seconds, value.microseconds)),
    datetime.timezone: _timezone,
    zoneinfo.ZoneInfo: _zone,
    uuid.UUID: lambda value: (uuid_, (value.bytes, value.is_safe.value)),
    **{kind: lambda value, at=at: (path, (at, str(value))) for at, kind in enumerate(_PATHS)},
    range: lambda value: (range_, (value.start, value.stop, value.step)),
    slice: lambda value: (slice_, (value.start, value.stop, value.step)),
    type(...): lambda _: (ellipsis_, (0,)),
    type(NotImplemented): lambda _: (ellipsis_, (1,)),
    memoryview: buffers.take,
    PickleBuffer: buffers.take,
    array.array: _array,
}
