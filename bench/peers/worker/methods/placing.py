"""Ways to place an array where another process can read it; each class is one.

`prepare` is not timed and sees the array first; `place` is timed; `release` is not, and frees what
`place` took, so that memory can be used again. Libraries are imported by the class that needs them.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import pickle

import numpy as np
from session import Session


class _Method:
    def __init__(self, session: Session) -> None:
        self.session = session

    def prepare(self, array: np.ndarray) -> None:
        """Nothing, unless a method needs it."""

    def place(self, array: np.ndarray) -> None:
        """Must be said by each method."""
        raise NotImplementedError

    def release(self) -> None:
        """Nothing, unless a method needs it."""


def _shared(name: str, size: int, flags: int) -> mmap.mmap:
    descriptor = os.memfd_create(name)
    try:
        os.ftruncate(descriptor, size)
        return mmap.mmap(descriptor, size, flags=mmap.MAP_SHARED | flags)
    finally:
        os.close(descriptor)


class recycled(_Method):  # noqa: N801
    """One memcpy into shared memory that is mapped and touched already: the least it can cost."""

    def prepare(self, array: np.ndarray) -> None:
        """Maps memory of the array's size."""
        self._map = _shared(self.session.name, array.nbytes, mmap.MAP_POPULATE)
        self._target = np.frombuffer(self._map, np.float64).reshape(array.shape)

    def place(self, array: np.ndarray) -> None:
        """Copies."""
        np.copyto(self._target, array)


class fresh(_Method):  # noqa: N801
    """One memcpy into shared memory that is made for it: every page of it is a fault."""

    def place(self, array: np.ndarray) -> None:
        """Maps and copies."""
        self._map = _shared(self.session.name, array.nbytes, 0)
        self._target = np.frombuffer(self._map, np.float64).reshape(array.shape)
        np.copyto(self._target, array)

    def release(self) -> None:
        """Unmaps."""
        del self._target
        self._map.close()


class shm_pickle(_Method):  # noqa: N801
    """Pickled in band into a new segment of `multiprocessing.shared_memory`."""

    def place(self, array: np.ndarray) -> None:
        """Pickles, makes the segment, copies."""
        from multiprocessing.shared_memory import SharedMemory

        pickled = pickle.dumps(array, protocol=5)
        self._segment = SharedMemory(self.session.name, create=True, size=len(pickled))
        self._segment.buf[: len(pickled)] = pickled

    def release(self) -> None:
        """Removes the segment."""
        self._segment.close()
        self._segment.unlink()


class shared_memory(_Method):  # noqa: N801
    """A new segment of `multiprocessing.shared_memory` for each array, as in the paper's figure.

    What is written has been pickled before: the time is that of the segment and of the bytes.
    """

    def prepare(self, array: np.ndarray) -> None:
        """Pickles."""
        self._pickled = pickle.dumps(array, protocol=5)

    def place(self, array: np.ndarray) -> None:
        """Makes the segment, copies, closes it."""
        from multiprocessing.shared_memory import SharedMemory

        size = len(self._pickled)
        self._segment = SharedMemory(self.session.name, create=True, size=size)
        self._segment.buf[:size] = self._pickled
        self._segment.close()

    def release(self) -> None:
        """Removes the segment."""
        self._segment.unlink()


class iceoryx2(_Method):  # noqa: N801
    """A loan, one copy, and the sample sent to a subscriber in the same process."""

    def __init__(self, session: Session) -> None:
        """Opens a service with room for the largest array."""
        super().__init__(session)
        import iceoryx2 as iox

        iox.set_log_level(iox.LogLevel.Error)
        config = iox.config.default()
        config.global_cfg.prefix = iox.FileName.new(f"{session.name}_")
        config.global_cfg.root_path = iox.Path.new(session.directory)
        self._node = iox.NodeBuilder.new().config(config).create(iox.ServiceType.Ipc)
        name = iox.ServiceName.new(session.name)
        builder = self._node.service_builder(name).publish_subscribe(iox.Slice[ctypes.c_uint8])
        builder = builder.subscriber_max_buffer_size(2).max_subscribers(1).max_publishers(1)
        self._service = builder.payload_alignment(iox.Alignment.new(64)).create()
        self._subscriber = self._service.subscriber_builder().create()
        publisher = self._service.publisher_builder().initial_max_slice_len(session.largest)
        self._publisher = publisher.create()

    def place(self, array: np.ndarray) -> None:
        """Borrows, copies, sends."""
        sample = self._publisher.loan_slice_uninit(array.nbytes)
        target = (ctypes.c_uint8 * array.nbytes).from_address(sample.payload_ptr)
        np.copyto(np.frombuffer(target, np.float64).reshape(array.shape), array)
        sample.assume_init().send()

    def release(self) -> None:
        """Takes the sample and drops it."""
        if self._subscriber.receive() is None:
            raise RuntimeError("the sample did not arrive")


class zenoh(_Method):
    """A buffer of the provider, written from the bytes that it takes."""

    def __init__(self, session: Session) -> None:
        """Makes a pool as large as in the other workloads."""
        super().__init__(session)
        import zenoh as library

        self._provider = library.shm.ShmProvider.default_backend(400_000_000)
        self._policy = library.shm.BlockOn(library.shm.GarbageCollect())

    def place(self, array: np.ndarray) -> None:
        """Allocates and copies twice."""
        self._buffer = self._provider.alloc(array.nbytes, policy=self._policy)
        self._buffer[:] = array.tobytes()

    def release(self) -> None:
        """Gives the buffer back."""
        self._buffer = None


class plasma(_Method):
    """An object created, written and sealed; deleted afterwards."""

    def __init__(self, session: Session) -> None:
        """Connects to the store that the harness has started."""
        super().__init__(session)
        from pyarrow import plasma as library
        from session import until

        self._library = library
        path = session.path("plasma")
        until("the store's socket", lambda: os.path.exists(path))
        self._client = library.connect(path)

    def place(self, array: np.ndarray) -> None:
        """Creates, copies, seals."""
        self._ident = self._library.ObjectID.from_random()
        buffer = self._client.create(self._ident, array.nbytes)
        np.copyto(np.frombuffer(buffer, np.float64).reshape(array.shape), array)
        self._client.seal(self._ident)

    def release(self) -> None:
        """Deletes the object."""
        self._client.delete([self._ident])


class ray(_Method):
    """`ray.put`."""

    def __init__(self, session: Session) -> None:
        """Starts Ray."""
        super().__init__(session)
        import logging

        import ray as library

        os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
        library.init(
            address="local",
            num_cpus=1,
            object_store_memory=2_000_000_000,
            include_dashboard=False,
            log_to_driver=False,
            logging_level=logging.ERROR,
            _temp_dir=session.directory,
        )
        self._put = library.put

    def place(self, array: np.ndarray) -> None:
        """Puts."""
        self._reference = self._put(array)

    def release(self) -> None:
        """Lets go."""
        self._reference = None
