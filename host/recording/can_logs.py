"""A trial from the log of another CAN tool."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import IO

from analysis.formats import StreamChoice
from firmware_protocol.can.mapping import MAX_NODE, MIN_NODE
from host.errors import FileError, UsageError
from host.links.can.logs import read_can_log
from host.recording.load import RecordedTrial, assemble


def load_can_log(
    path: Path, node: int | None = None, file: IO[bytes] | None = None, choice: StreamChoice | None = None
) -> RecordedTrial:
    """Read a candump log, ASC, BLF, or a CSV of python-can.

    Parameters
    ----------
    path : Path
        The log.
    node : int, optional
        Node id of the object; by default the first that is heard.
    file : binary file, optional
        The log where it is open already; see :func:`read_can_log`.

    Raises
    ------
    UsageError
        No such node id.
    FileError
        Not a CAN log, or no object in it.
    """
    if node is not None and not MIN_NODE <= node <= MAX_NODE:
        raise UsageError(f"{node} is not a valid node id", f"give one from {MIN_NODE} to {MAX_NODE}")
    log = read_can_log(path, file)
    trial = assemble(log.chunks, path.name, node)
    if not len(trial.series):
        whose = "an object" if node is None else f"the object with node id {node}"
        raise FileError(f"{path} holds no samples of {whose}", "check that the log covers the trial, and --node")
    return replace(trial, damage=log.damage)
