"""Showing what a running federation sends in Foxglove: ``hprm echo --foxglove``.

``watch`` gives the messages, ``_views`` says how values are shown; here they become messages of
Foxglove, which its own package ``foxglove-sdk`` sends to every viewer that connects. A value is
converted only if a viewer wants to see it.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from typing import Any

import foxglove
import numpy as np
import numpy.typing as npt
from foxglove.channels import LogChannel, PointCloudChannel, RawImageChannel
from foxglove.messages import (
    Log,
    LogLevel,
    PackedElementField,
    PointCloud,
    RawImage,
    Timestamp,
)
from foxglove.messages import PackedElementFieldNumericType as _Number

from hprm._hprm import WatchedMessage
from hprm._views import Cloud, Field, Fields, Image, Nothing, Text, View, views
from hprm._watching import WatchError

# Where all points are, so that a 3D panel shows them without being told more.
_FRAME = "world"

_CHANNELS: dict[type[View], Any] = {
    Image: RawImageChannel,
    Cloud: PointCloudChannel,
    Text: LogChannel,
}


class Viewers:
    """A server for viewers, and what they can see."""

    def __init__(self, host: str, port: int) -> None:
        """Listen at an address. Raises ``WatchError`` if that is not possible."""
        self._context = foxglove.Context()
        self._channels: dict[tuple[str, type[View]], Any] = {}
        self._kinds: dict[str, type[View]] = {}
        # What has been told on the standard error.
        self._told: set[str] = set()
        try:
            self._server = foxglove.start_server(
                name="HPRM", host=host, port=port, context=self._context
            )
        except (OverflowError, RuntimeError) as error:
            raise WatchError(
                f"cannot listen at {host}:{port}: {str(error).rpartition(': ')[2]}",
                "name an address of this machine and a free port: --foxglove=127.0.0.1:0 takes any",
            ) from None
        self.address = f"ws://{host}:{self._server.port}"

    def stop(self) -> None:
        """Let the viewers go."""
        self._server.stop()

    def show(self, messages: Iterable[WatchedMessage]) -> None:
        """Show messages, as long as there are any."""
        for message in messages:
            self._show(message)

    def _show(self, message: WatchedMessage) -> None:
        topic = topic_of(message.port)
        time = message.sent if message.tag is None else message.tag.time
        about: dict[str, Field] = {
            "elapsed": message.elapsed / 1e9,
            "sent": message.sent / 1e9,
            "delay": (message.sent - time) / 1e9,
            "size": message.size,
            "missed": message.missed,
        }
        self._log(f"{topic}/message", Fields(about), time)
        try:
            shown = list(views(message.value))
        except Exception as error:
            # A value may be of any class, and what is wrong with it is no reason to show nothing.
            told = error.message if isinstance(error, WatchError) else f"{error!r}"
            self._tell(f"{message.port} is not shown: {told}")
            return
        for path, view in shown:
            if isinstance(view, Nothing):
                self._tell(f"{message.port}{path} is not shown: it is {view.why}")
            else:
                self._log(topic + path, view, time)

    def _log(self, topic: str, view: View, time: int) -> None:
        # A viewer expects one kind of messages of a topic.
        if self._kinds.setdefault(topic, type(view)) is not type(view):
            topic = f"{topic}/{type(view).__name__.lower()}"
        channel = self._channels.get((topic, type(view)))
        if channel is None:
            channel = self._channels[topic, type(view)] = self._channel(topic, view)
        if not channel.has_sinks():
            return
        at = Timestamp(time // 1_000_000_000, time % 1_000_000_000)
        if isinstance(view, Fields):
            channel.log(view.fields, log_time=time)
        elif isinstance(view, Image):
            channel.log(_image(view, at), log_time=time)
        elif isinstance(view, Cloud):
            channel.log(_cloud(view, at), log_time=time)
        elif isinstance(view, Text):
            log = Log(timestamp=at, level=LogLevel.Info, message=view.text, name=topic)
            channel.log(log, log_time=time)

    def _channel(self, topic: str, view: View) -> Any:
        if isinstance(view, Fields):
            schema = {"title": topic, **_schema(view.fields)}
            return foxglove.Channel(topic, schema=schema, context=self._context)
        return _CHANNELS[type(view)](topic, context=self._context)

    def _tell(self, what: str) -> None:
        if what not in self._told:
            self._told.add(what)
            print(what, file=sys.stderr, flush=True)


def topic_of(port: str) -> str:
    """Return the name of a topic, in which brackets would mean something: ``/camera/1/image``."""
    return "/" + re.sub(r"\[(\d+)\]", r"/\1", port).replace(".", "/")


def _image(view: Image, at: Timestamp) -> RawImage:
    pixels: npt.NDArray[Any] = view.pixels
    if pixels.dtype != np.uint8:
        pixels = pixels.astype("<u2" if view.encoding == "mono16" else "<f4", copy=False)
    height, width = pixels.shape[:2]
    data = pixels.tobytes()
    return RawImage(
        timestamp=at,
        frame_id=_FRAME,
        width=width,
        height=height,
        encoding=view.encoding,
        step=len(data) // height,
        data=data,
    )


def _cloud(view: Cloud, at: Timestamp) -> PointCloud:
    double = view.points.dtype.itemsize > 4
    points = view.points.astype("<f8" if double else "<f4", copy=False)
    kind = _Number.Float64 if double else _Number.Float32
    names = ("x", "y", "z", "intensity")[: points.shape[1]]
    size = points.dtype.itemsize
    return PointCloud(
        timestamp=at,
        frame_id=_FRAME,
        point_stride=size * len(names),
        fields=[
            PackedElementField(name=name, offset=at * size, type=kind)
            for at, name in enumerate(names)
        ],
        data=points.tobytes(),
    )


def _schema(field: Field) -> dict[str, Any]:
    """Describe fields as JSON Schema does, so that viewers offer them."""
    if isinstance(field, dict):
        properties = {name: _schema(inner) for name, inner in field.items()}
        return {"type": "object", "properties": properties}
    if isinstance(field, list):
        return {"type": "array", "items": _schema(field[0]) if field else {}}
    if isinstance(field, str):
        return {"type": "string"}
    # What is a whole number now may be another one later.
    return {"type": "boolean" if isinstance(field, bool) else "number"}
