"""Of pyarrow: arrays, batches and tables, as streams of Arrow that are written where they go.

What has arrived from another machine is checked in full, because otherwise offsets in it could lead
anywhere.
"""

from pickle import PickleBuffer
from typing import Any

from hprm._kinds import Parts, Written


def schema(stream: memoryview, *, trusted: bool) -> Any:
    """Make a schema."""
    return _reader(stream).schema


def batch(stream: memoryview, *, trusted: bool) -> Any:
    """Make a record batch."""
    return _checked(_reader(stream).read_next_batch(), trusted)


def table(stream: memoryview, *, trusted: bool) -> Any:
    """Make a table."""
    return _checked(_reader(stream).read_all(), trusted)


def array_(stream: memoryview, *, trusted: bool) -> Any:
    """Make an array."""
    return batch(stream, trusted=trusted).column(0)


def chunked(stream: memoryview, *, trusted: bool) -> Any:
    """Make an array of chunks."""
    return table(stream, trusted=trusted).column(0)


def scalar(stream: memoryview, *, trusted: bool) -> Any:
    """Make a single value."""
    return array_(stream, trusted=trusted)[0]


def taker(kind: type) -> Any:
    """Return what takes apart values of a class of pyarrow."""
    pyarrow = _library()
    takers = {
        pyarrow.Schema: lambda value: (schema, (_stream(value, []),)),
        pyarrow.RecordBatch: lambda value: (batch, (_stream(value.schema, [value]),)),
        pyarrow.Table: lambda value: (table, (_stream(value.schema, value.to_batches()),)),
        pyarrow.ChunkedArray: _take_chunked,
    }
    if issubclass(kind, pyarrow.Array):
        return lambda value: (array_, (_stream_of(value),))
    if issubclass(kind, pyarrow.Scalar):
        return lambda value: (scalar, (_stream_of(pyarrow.array([value], value.type)),))
    return takers.get(kind)


def elements(value: Any) -> list[Any]:
    """Return what a value of pyarrow says, whatever its buffers look like: for digests."""
    pyarrow = _library()
    if isinstance(value, pyarrow.Schema):
        return [PickleBuffer(value.serialize())]
    if isinstance(value, pyarrow.Table | pyarrow.RecordBatch):
        return [value.schema, *value.columns]
    if isinstance(value, pyarrow.ChunkedArray):
        joined = pyarrow.concat_arrays(value.chunks) if value.num_chunks else None
        return [str(value.type), joined]
    if isinstance(value, pyarrow.Array) and pyarrow.types.is_primitive(value.type):
        valid = value.is_valid().to_numpy(zero_copy_only=False)
        return [str(value.type), valid, value.drop_null().to_numpy(zero_copy_only=False)]
    if isinstance(value, pyarrow.Array):
        return [str(value.type), value.to_pylist()]
    return [str(value.type), value.as_py()]


def _library() -> Any:
    import pyarrow

    return pyarrow


def _take_chunked(value: Any) -> Parts:
    table = _library().Table.from_arrays([value], names=[""])
    return chunked, (_stream(table.schema, table.to_batches()),)


def _stream_of(array: Any) -> Written:
    batch = _library().RecordBatch.from_arrays([array], names=[""])
    return _stream(batch.schema, [batch])


def _stream(schema: Any, batches: list[Any]) -> Written:
    import pyarrow.ipc

    pyarrow = _library()

    def write_into(sink: Any) -> None:
        with pyarrow.ipc.new_stream(sink, schema) as stream:
            for each in batches:
                stream.write_batch(each)

    def write(target: Any) -> None:
        memory = pyarrow.py_buffer(target)
        sink = pyarrow.FixedSizeBufferWriter(memory)
        write_into(sink)
        if sink.tell() != memory.size:
            # The rest would be what was in the memory before.
            raise RuntimeError("a value of pyarrow has changed while it was being sent")
        sink.close()

    with pyarrow.MockOutputStream() as counter:
        write_into(counter)
        return Written(counter.size(), write)


def _reader(stream: memoryview) -> Any:
    import pyarrow
    import pyarrow.ipc

    return pyarrow.ipc.open_stream(pyarrow.py_buffer(PickleBuffer(stream)))


def _checked(made: Any, trusted: bool) -> Any:
    made.validate(full=not trusted)
    return made
