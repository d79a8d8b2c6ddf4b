"""From one format of bags to the other, without looking into messages."""

from __future__ import annotations

import sqlite3
from pathlib import Path

from rosbags.interfaces import ConnectionExtRosbag2

from hprm.ros._bags.definitions import definition_in
from hprm.ros._bags.errors import BagError, reading
from hprm.ros._bags.information import BagInfo
from hprm.ros._bags.reading import BagReader
from hprm.ros._bags.writing import Draft

_OTHER = {"mcap": "sqlite3", "sqlite3": "mcap"}


def convert(source: str | Path, destination: str | Path, storage: str | None = None) -> BagInfo:
    """Write a copy of a bag, in the other format or in ``storage``. Return what the copy has in it.

    Raises ``BagError`` if that is not possible; then nothing is left at ``destination``.
    """
    path = Path(destination)
    with BagReader(source) as bag:
        draft = Draft(path, storage or _OTHER.get(bag.info.storage, "mcap"))
        try:
            _copy(bag, draft)
        except (OSError, sqlite3.Error) as error:
            draft.abort()
            raise BagError(f"{path} cannot be written: {error}") from error
        except BaseException:
            draft.abort()
            raise
        draft.commit(bag.info.lost)
    with BagReader(path) as made:
        return made.info


def _copy(bag: BagReader, draft: Draft) -> None:
    connections = bag.connections()
    added = {}
    for it in connections:
        qos = it.ext.offered_qos_profiles if isinstance(it.ext, ConnectionExtRosbag2) else []
        with reading(bag.path):
            definition = definition_in(bag.path, it)
        added[it.id] = draft.add(it.topic, it.msgtype, definition, qos)
    for connection, time, data in bag.raw(connections):
        draft.write(added[connection.id], time, data)
