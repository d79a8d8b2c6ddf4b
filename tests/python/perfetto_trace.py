"""Reading a trace of a run with Perfetto's own schema, independently of what writes it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from perfetto.protos.perfetto.trace.perfetto_trace_pb2 import Trace, TrackEvent


@dataclass
class Slice:
    """A slice or an instant, with the names of its process and its thread."""

    name: str
    category: str
    process: str
    thread: str
    begin: int
    end: int | None
    arguments: dict[str, Any]
    flows: list[int] = field(default_factory=list)
    ends: list[int] = field(default_factory=list)

    @property
    def tag(self) -> tuple[int, int]:
        """The tag that it is about."""
        return self.arguments["tag"], self.arguments["microstep"]


def read(path: Path) -> list[Slice]:
    """Return all slices and instants, after checking what holds for every trace.

    Slices nest on their track and times go up there, and every name and track is described
    before it is used.
    """
    trace = Trace()
    trace.ParseFromString(path.read_bytes())
    names: dict[tuple[str, int, int], str] = {}
    tracks: dict[int, tuple[str, str]] = {}
    processes: dict[int, str] = {}
    open_slices: dict[int, list[Slice]] = {}
    latest: Counter[int] = Counter()
    slices: list[Slice] = []
    for packet in trace.packet:
        sequence = packet.trusted_packet_sequence_id
        if packet.sequence_flags & 1:
            names = {key: name for key, name in names.items() if key[1] != sequence}
        if packet.HasField("track_descriptor"):
            track = packet.track_descriptor
            if track.HasField("process"):
                processes[track.uuid] = track.process.process_name
            else:
                tracks[track.uuid] = processes[track.parent_uuid], track.thread.thread_name
        for kind in ("event_categories", "event_names", "debug_annotation_names"):
            for entry in getattr(packet.interned_data, kind):
                names[kind, sequence, entry.iid] = entry.name
        if not packet.HasField("track_event"):
            continue
        event = packet.track_event
        stack = open_slices.setdefault(event.track_uuid, [])
        assert packet.timestamp >= latest[event.track_uuid]
        latest[event.track_uuid] = packet.timestamp
        if event.type == TrackEvent.TYPE_SLICE_END:
            stack.pop().end = packet.timestamp
            continue
        arguments = {
            names["debug_annotation_names", sequence, it.name_iid]: (
                it.int_value if it.HasField("int_value") else it.string_value
            )
            for it in event.debug_annotations
        }
        slices.append(
            Slice(
                names["event_names", sequence, event.name_iid],
                names["event_categories", sequence, event.category_iids[0]],
                *tracks[event.track_uuid],
                packet.timestamp,
                None,
                arguments,
                list(event.flow_ids),
                list(event.terminating_flow_ids),
            )
        )
        if event.type == TrackEvent.TYPE_SLICE_BEGIN:
            stack.append(slices[-1])
    return slices


def arrows(slices: list[Slice]) -> list[tuple[Slice, Slice]]:
    """Return the ends of all arrows that have two."""
    begins = {flow: it for it in slices for flow in it.flows if not it.name.startswith("forward ")}
    return [(begins[flow], it) for it in slices for flow in it.ends if flow in begins]
