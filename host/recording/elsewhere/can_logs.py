"""A trial from the log of another CAN tool: of one object, on one channel, in one session of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import IO

import numpy as np

from analysis.formats import StreamChoice
from analysis.formats.rows.streams import SeveralStreamsError, chosen, counted
from firmware_protocol.can.frames import FrameArray, FrameFlag, frame_array
from firmware_protocol.can.mapping import (
    FUNCTION_MASK,
    MAX_NODE,
    MIN_NODE,
    NODE_BITS,
    NODE_MASK,
    SEQUENCE_MODULUS,
    CanFunction,
)
from host.errors import FileError, UsageError
from host.links.can.logs import CanLog, read_can_log
from host.links.transport import FrameChunk
from host.recording.load import RecordedTrial, assemble

MIN_SAMPLES = 20
"""Fewer than these, or than a tenth of what another object sent, are strays: they do not hide a trial."""
SILENCE_S = 30.0
"""An object that is silent for longer starts another session."""
SILENCE_AT_RESTART_S = 5.0
"""So much where it counts its samples from the start again."""
CLOCKS_APART_S = 1e8
"""Times further apart are of two clocks: since the start of a log, and since 1970."""
_NOT_DATA = FrameFlag.EXTENDED | FrameFlag.REMOTE | FrameFlag.ERROR


@dataclass(frozen=True)
class LoggedObject:
    """An object whose samples are in a log."""

    channel: str
    node: int
    samples: int


def load_can_log(
    path: Path, node: int | None = None, file: IO[bytes] | None = None, choice: StreamChoice | None = None
) -> RecordedTrial:
    """Read a candump log, ASC, BLF, TRC, or a CSV of python-can.

    Parameters
    ----------
    path : Path
        The log.
    node : int, optional
        Node id of the object; by default the first that is heard and is no stray.
    file : binary file, optional
        The log where it is open already; see :func:`read_can_log`.
    choice : StreamChoice, optional
        Which channel and session, where there are several.

    Raises
    ------
    UsageError
        No such node id.
    SeveralStreamsError
        Objects on several channels, or several sessions, and no choice.
    FileError
        Not a CAN log, or no object in it.
    """
    if node is not None and not MIN_NODE <= node <= MAX_NODE:
        raise UsageError(f"{node} is not a valid node id", f"give one from {MIN_NODE} to {MAX_NODE}")
    choice = choice or StreamChoice()
    log = read_can_log(path, file)
    objects = [item for item in _objects(log) if node is None or item.node == node]
    remarks: list[str] = []
    if objects:
        channel, node = _chosen_object(objects, node, choice, remarks)
    else:  # none that shows itself by its TIME frames: the first that is heard
        channel = chosen("channel", sorted(log.channels), choice.channel) if choice.channel else _fullest(log)
    chunks, note = _session(log.channels[channel], node, choice, remarks)
    trial = assemble(chunks, path.name, node)
    if not len(trial.series):
        whose = "an object" if node is None else f"the object with node id {node}"
        raise FileError(f"{path} holds no samples of {whose}", "check that the log covers the trial, and --node")
    series = trial.series.with_remarks(notes=note)
    return replace(trial, series=series, damage=(*remarks, *log.damage))


def _objects(log: CanLog) -> list[LoggedObject]:
    """Return the objects of a log, those of each channel in the order in which they are heard.

    Other devices have the same ids: what makes an object is that TIME frames stand among its samples.
    """
    found = []
    for channel, chunks in log.channels.items():
        samples: dict[int, int] = {}
        times: dict[int, int] = {}
        for chunk in chunks:
            records = _plain_frames(chunk)
            nodes = records["arbitration_id"] & NODE_MASK
            function = records["arbitration_id"] >> NODE_BITS & FUNCTION_MASK
            for which, counts in ((CanFunction.ORIENTATION, samples), (CanFunction.TIME, times)):
                own = nodes[(function == which) & (records["length"] >= 8)]
                for node in dict.fromkeys(own.tolist()):
                    counts[node] = counts.get(node, 0) + int(np.sum(own == node))
        found += [
            LoggedObject(channel, node, n)
            for node, n in samples.items()
            if node >= MIN_NODE and 2 * SEQUENCE_MODULUS * times.get(node, 0) >= n
        ]
    return found


def _plain_frames(chunk: FrameChunk) -> FrameArray:
    records = frame_array(chunk.data)
    plain: FrameArray = records[(records["flags"] & _NOT_DATA) == 0]
    return plain


def _chosen_object(
    objects: Sequence[LoggedObject], node: int | None, choice: StreamChoice, remarks: list[str]
) -> tuple[str, int]:
    """Return channel and node id of the object to score."""
    most = max(item.samples for item in objects)
    real = [item for item in objects if item.samples >= max(0.1 * most, min(MIN_SAMPLES, most))]
    there = real if choice.channel is None else objects
    channel = chosen("channel", list(dict.fromkeys(item.channel for item in there)), choice.channel)
    here = [item for item in objects if item.channel == channel]
    first = next((item for item in real if item.channel == channel), here[0])
    if len(here) > 1 and node is None:
        nodes = counted("node", [str(item.node) for item in here])
        remarks.append(f"the log holds {nodes}; node {first.node} is scored (--node chooses another)")
    return channel, first.node


def _fullest(log: CanLog) -> str:
    return max(log.channels, key=lambda channel: sum(len(chunk.data) for chunk in log.channels[channel]))


def _session(
    chunks: Sequence[FrameChunk], node: int | None, choice: StreamChoice, remarks: list[str]
) -> tuple[Sequence[FrameChunk], tuple[str, ...]]:
    """Return the chunks of one session, and a note where there are several."""
    edges, starts_s, mixed = [0], list[float](), False
    latest_s, counter = None, None
    for place, chunk in enumerate(chunks):
        records = _plain_frames(chunk)
        if node is not None:
            records = records[(records["arbitration_id"] & NODE_MASK) == node]
        function = records["arbitration_id"] >> NODE_BITS & FUNCTION_MASK
        own = records[(function == CanFunction.ORIENTATION) | (function == CanFunction.TIME)]
        if not len(own):
            continue
        first_s = float(own["host_time_ns"][0]) * 1e-9
        counters = records["code"][function == CanFunction.TIME] & 0xFFFFFFFF
        restarted = counter is not None and len(counters) > 0 and int(counters[0]) < counter
        starts_s = starts_s or [first_s]
        silent_s = 0.0 if latest_s is None else first_s - latest_s
        if silent_s > (SILENCE_AT_RESTART_S if restarted else SILENCE_S) or silent_s < -1.0:
            edges.append(place)
            starts_s.append(first_s)
            mixed |= abs(silent_s) > CLOCKS_APART_S
        latest_s = float(own["host_time_ns"][-1]) * 1e-9
        counter = int(counters[-1]) if len(counters) else counter
    n = len(edges)
    if choice.session is not None and not 1 <= choice.session <= n:
        raise FileError(f"no session {choice.session}; there are {n}")
    if mixed:
        remarks.append(
            "the log mixes times since its start with times since 1970: the times between sessions are not known"
        )
    if n == 1:
        return chunks, ()
    listed = [f"{k + 1} (from {start_s - starts_s[0]:.1f} s)" for k, start_s in enumerate(starts_s)]
    if choice.session is None:
        raise SeveralStreamsError(
            f"{counted('session', listed)}; choose with --session 1", "session", [str(k + 1) for k in range(n)]
        )
    first, last = list(pairwise([*edges, len(chunks)]))[choice.session - 1]
    return chunks[first:last], (f"{counted('session', listed)}; session {choice.session} is read",)
