"""Of pandas: frames, series and indices, column by column.

A column is an array of NumPy, or one of pandas' own kinds of arrays. A frame of another class, or
with a column of a kind that is not known here, is left to pickle.
"""

from typing import Any

import numpy

from hprm._kinds import Parts


def frame(columns: Any, index: Any, data: list[Any], attrs: dict[Any, Any], unique: bool) -> Any:
    """Make a frame."""
    pandas = _library()
    made = pandas.DataFrame(dict(enumerate(data)), index=index, copy=False)
    made.columns = columns
    made.attrs = attrs
    made.flags.allows_duplicate_labels = unique
    return made


def series(data: Any, index: Any, name: Any, attrs: dict[Any, Any], unique: bool) -> Any:
    """Make a series."""
    made = _library().Series(data, index=index, name=name, dtype=data.dtype, copy=False)
    made.attrs = attrs
    made.flags.allows_duplicate_labels = unique
    return made


def index(data: Any, name: Any, frequency: str | None) -> Any:
    """Make an index."""
    pandas = _library()
    made = pandas.Index(data, dtype=data.dtype, name=name, copy=False)
    if frequency is not None:
        made.freq = frequency
    return made


def range_index(numbers: range, name: Any) -> Any:
    """Make an index of numbers in a row."""
    return _library().RangeIndex(numbers, name=name)


def multi_index(levels: list[Any], codes: list[Any], names: list[Any]) -> Any:
    """Make an index of several levels."""
    return _library().MultiIndex(levels, codes, names=names)


def categorical(codes: Any, categories: Any, ordered: bool) -> Any:
    """Make a column of categories."""
    pandas = _library()
    dtype = pandas.CategoricalDtype(categories, ordered)
    return pandas.Categorical.from_codes(codes, dtype=dtype)


def zoned(instants: Any, zone: Any) -> Any:
    """Make a column of points in time in a zone."""
    return _library().DatetimeIndex(instants, tz="UTC").tz_convert(zone).array


def masked(data: Any, mask: Any) -> Any:
    """Make a column of numbers some of which may be missing."""
    arrays = _library().arrays
    kinds = {"b": arrays.BooleanArray, "f": arrays.FloatingArray}
    # Over a copy of what is small, and read-only like all others.
    return kinds.get(data.dtype.kind, arrays.IntegerArray)(data, mask)


def strings(texts: Any, storage: str, missing: Any) -> Any:
    """Make a column of strings."""
    pandas = _library()
    return pandas.array(texts, dtype=pandas.StringDtype(storage, na_value=missing))


def arrow_backed(data: Any, kind: str, missing: Any) -> Any:
    """Make a column that lies in an array of pyarrow."""
    pandas = _library()
    if kind == "string":
        return pandas.StringDtype("pyarrow", na_value=missing).__from_arrow__(data)
    return pandas.arrays.ArrowExtensionArray(data)


def timestamp(value: Any, zone: Any, unit: str) -> Any:
    """Make a point in time."""
    made = _library().Timestamp(value).as_unit(unit)
    return made if zone is None else made.tz_localize("UTC").tz_convert(zone)


def duration(value: Any, unit: str) -> Any:
    """Make a duration."""
    return _library().Timedelta(value).as_unit(unit)


def missing(which: str) -> Any:
    """Find a constant that stands for what is missing."""
    pandas = _library()
    return {"NA": pandas.NA, "NaT": pandas.NaT}[which]


def periods(ordinals: Any, frequency: str) -> Any:
    """Make a column of periods."""
    pandas = _library()
    return pandas.arrays.PeriodArray(ordinals, dtype=pandas.PeriodDtype(frequency))


def intervals(left: Any, right: Any, closed: str) -> Any:
    """Make a column of intervals."""
    return _library().arrays.IntervalArray.from_arrays(left, right, closed=closed)


def taker(kind: type) -> Any:
    """Return what takes apart values of a class of pandas."""
    pandas = _library()
    takers = {
        pandas.DataFrame: _take_frame,
        pandas.Series: _take_series,
        pandas.RangeIndex: lambda value: (range_index, (range(*_bounds(value)), value.name)),
        pandas.MultiIndex: _take_multi_index,
        pandas.Timestamp: _take_timestamp,
        pandas.Timedelta: _take_duration,
        type(pandas.NA): lambda _: (missing, ("NA",)),
        type(pandas.NaT): lambda _: (missing, ("NaT",)),
    }
    if kind in takers:
        return takers[kind]
    if issubclass(kind, pandas.Index):
        return _take_index
    if issubclass(kind, pandas.api.extensions.ExtensionArray):
        return _take_column
    return None


def _library() -> Any:
    import pandas

    return pandas


def _take_frame(value: Any) -> Parts:
    columns = [_elements(value.iloc[:, at]) for at in range(value.shape[1])]
    unique = value.flags.allows_duplicate_labels
    return frame, (value.columns, value.index, columns, value.attrs, unique)


def _take_series(value: Any) -> Parts:
    unique = value.flags.allows_duplicate_labels
    return series, (_elements(value), value.index, value.name, value.attrs, unique)


def _take_index(value: Any) -> Parts | None:
    frequency = getattr(value, "freq", None) if hasattr(type(value), "freq") else None
    if type(value).__name__ == "PeriodIndex":
        frequency = None
    if frequency is None:
        return index, (_elements(value), value.name, None)
    name = frequency.freqstr
    return (index, (_elements(value), value.name, name)) if _is_told(frequency, name) else None


def _is_told(frequency: Any, name: str) -> bool:
    """Whether the name of a frequency tells all of it: not the holidays of one, for example."""
    try:
        return bool(_library().tseries.frequencies.to_offset(name) == frequency)
    except ValueError:
        return False


def _take_multi_index(value: Any) -> Parts:
    codes = [numpy.asarray(codes) for codes in value.codes]
    return multi_index, (list(value.levels), codes, list(value.names))


def _bounds(value: Any) -> tuple[int, int, int]:
    return value.start, value.stop, value.step


def _elements(value: Any) -> Any:
    """Return the elements of a series or an index: an array of NumPy, or of pandas."""
    plain = isinstance(value.dtype, numpy.dtype)
    return value.to_numpy(copy=False) if plain else value.array


def _take_column(value: Any) -> Parts | None:
    pandas = _library()
    dtype = value.dtype
    if isinstance(dtype, numpy.dtype):
        # Only what pandas wraps around an array of NumPy.
        return None
    match dtype:
        case pandas.CategoricalDtype():
            return categorical, (numpy.asarray(value.codes), value.categories, value.ordered)
        case pandas.DatetimeTZDtype():
            return zoned, (numpy.asarray(value.tz_convert(None)), value.tz)
        case pandas.PeriodDtype():
            return periods, (
                numpy.asarray(value.asi8),
                dtype.name.removeprefix("period[").removesuffix("]"),
            )
        case pandas.IntervalDtype():
            return intervals, (value.left, value.right, value.closed)
        case pandas.StringDtype(storage="python"):
            return strings, (value.to_numpy(object), dtype.storage, dtype.na_value)
        case pandas.StringDtype():
            return arrow_backed, (value.__arrow_array__(), "string", dtype.na_value)
        case pandas.ArrowDtype():
            return arrow_backed, (value.__arrow_array__(), "arrow", None)
    if isinstance(value, pandas.arrays.BooleanArray):
        return masked, (value.to_numpy(bool, na_value=False), value.isna())
    if isinstance(value, pandas.arrays.IntegerArray | pandas.arrays.FloatingArray):
        return masked, (value.to_numpy(dtype.numpy_dtype, na_value=0), value.isna())
    return None


def _take_timestamp(value: Any) -> Parts:
    zone = value.tz
    plain = value if zone is None else value.tz_convert(None)
    return timestamp, (plain.to_datetime64(), zone, value.unit)


def _take_duration(value: Any) -> Parts:
    return duration, (value.to_timedelta64(), value.unit)
