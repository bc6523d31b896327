"""The result of a trial: θ̄ first, then how far to trust it, then the cycles it was made of.

:class:`Result` is the layout of the JSON, read and written by msgspec; ``docs/benchmark.md`` lists the fields, and
``docs/result.schema.json`` is made from it. The analysis fills all fields but the last block, which the host fills for
recordings of its own.
"""

from __future__ import annotations

import json
from typing import TypeAlias

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType

from analysis.scoring.interval import DriftInterval
from analysis.scoring.recorded_parts import (
    CaptureAccount,
    CycleLosses,
    LinkAccount,
    Losses,
    ObjectEvent,
    OfflineClock,
    OperatorEvent,
    Quality,
    RecordedObject,
)
from analysis.scoring.result_parts import (
    CycleSearch,
    Diagnostics,
    ExcludedCycle,
    OtherExtreme,
    Part,
    PublishedDrift,
    ScoredEndpoint,
    ScoredWindow,
    SensorShare,
    Settings,
    Source,
    Vector,
)
from analysis.series import FloatArray

RESULT_FORMAT = 1
"""Version of the JSON layout."""

PlainValues: TypeAlias = dict[str, object]
"""A JSON object as Python reads it."""


class Result(Part, frozen=True, kw_only=True):
    """Everything about one trial. θ̄ and what follows from it are None unless ``valid``."""

    format: int
    """Version of this layout."""
    theta_bar_deg: float | None
    """θ̄ by the card."""
    axis: Vector | None
    """Axis of the average step, world frame."""
    n_endpoints: int
    """End points that count."""
    interval_deg: tuple[float, float] | None
    """Ends of the confidence interval; None with fewer than 4 steps."""
    valid: bool
    """Whether a drift may be claimed."""
    reasons: tuple[str, ...]
    """Why not; empty where valid."""
    warnings: tuple[str, ...]
    """What to keep in mind."""
    endpoints: tuple[ScoredEndpoint, ...]
    """End points, also where the trial is not valid."""
    steps_deg: tuple[float, ...]
    """(n − 1,) angle of every step; empty unless valid."""
    flags: tuple[tuple[str, ...], ...]
    """(n,) flags of the end points."""
    period_s: float | None
    """Median distance between end points."""
    other_extreme: OtherExtreme | None
    """The same trial at the other turning point."""
    companions: Diagnostics | None
    """What θ̄ hides."""
    sensor: SensorShare | None
    """How much the sensor alone may contribute."""
    window: ScoredWindow
    """Which end points count, and who decided."""
    cycles: CycleSearch
    """The search that found (or would have found) the end points."""
    losses: Losses | None
    """What the link lost; None for files."""
    recording: Source
    """What was scored."""
    settings: Settings
    """Numbers of the method."""
    excluded_cycles: tuple[ExcludedCycle, ...] = ()
    as_published: PublishedDrift | None = None
    """The authors' figure, where asked for."""

    rotdrift_version: str = ""
    """Version of the program that made it."""
    object: RecordedObject | UnsetType | None = UNSET
    """None where the object never introduced itself."""
    link: LinkAccount | None = None
    """The link and its counters; None for files."""
    missing_per_cycle: tuple[int, ...] | None = None
    """Missing samples of each cycle, in order."""
    losses_per_cycle: tuple[CycleLosses, ...] | None = None
    """The account of losses of each cycle; None for files."""
    quality: Quality | None = None
    """What the losses come to; None for files."""
    events: tuple[ObjectEvent, ...] | None = None
    """Buttons and markers of the object; None for files."""
    operator: tuple[OperatorEvent, ...] | None = None
    """What the operator did during the capture; None for files."""
    capture: CaptureAccount | None = None
    """How the capture went, where it has just ended."""
    clock: OfflineClock | UnsetType | None = UNSET
    """Absent unless asked for, because it may take longer than all the rest; None where nothing is known."""

    @property
    def interval(self) -> DriftInterval | None:
        """Confidence interval of θ̄ and what it was made of."""
        return None if self.companions is None else self.companions.interval

    @property
    def index_kind(self) -> str:
        """How its samples are named: ``row`` or ``sequence``."""
        return "sequence" if self.endpoints and self.endpoints[0].sequence is not None else "row"

    @property
    def endpoint_times_s(self) -> FloatArray:
        """(n,) times of the end points, recording's own, s."""
        return np.array([point.time_s for point in self.endpoints], dtype=np.float64)

    @property
    def endpoint_quats_wxyz(self) -> FloatArray:
        """(n, 4) orientations of the end points."""
        return endpoint_quats(self.endpoints)

    def to_json(self) -> PlainValues:
        """Return the JSON as plain values: finite numbers, None for what is unknown."""
        return _plain_values(self)

    def __repr__(self) -> str:
        """One line for an interactive session; every attribute printed would fill pages."""
        if self.theta_bar_deg is None:
            return f"Result(no score: {'; '.join(self.reasons)})"
        ends = "" if self.interval_deg is None else " ({:.3f} … {:.3f})".format(*self.interval_deg)
        return f"Result(θ̄ = {self.theta_bar_deg:.3f}°{ends}, {len(self.endpoints)} end points)"

    def _repr_html_(self) -> str:
        """Show the result in a notebook."""
        from analysis.scoring.summary import result_html  # it needs this module

        return result_html(self)


def endpoint_quats(points: tuple[ScoredEndpoint, ...]) -> FloatArray:
    """Return the (n, 4) orientations of n end points, scalar first."""
    return np.array([point.quat_wxyz for point in points], dtype=np.float64).reshape(-1, 4)


def _plain_number(value: object) -> object:
    """Return a numpy number as Python's: callers of the library choose windows and end points with either."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} is not part of a result")


def _plain_values(value: Result | PlainValues) -> PlainValues:
    # Through the JSON itself, where NaN becomes null.
    values: PlainValues = msgspec.json.decode(msgspec.json.encode(value, enc_hook=_plain_number))
    return values


def result_text(value: Result | PlainValues) -> str:
    """Return a result, or plain values that hold results, as JSON: readable, strict, numbers at full precision."""
    # Numbers are written by json, 1e-05 as in all results before; msgspec would write 0.00001.
    return json.dumps(_plain_values(value), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def parse_result(data: bytes) -> Result:
    """Read a result.

    Raises
    ------
    ValueError
        Not JSON, or a field that is missing, unknown or of the wrong kind; the message names it.
    """
    try:
        return msgspec.json.decode(data, type=Result)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"not a valid result: {error}") from error


def schema_text(kind: type[msgspec.Struct], title: str) -> str:
    """Return the JSON Schema (2020-12) of a type."""
    schema = msgspec.json.schema(kind)
    body = schema["$defs"].pop(kind.__name__)
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", **body, "title": title}
    return json.dumps({**head, "$defs": schema["$defs"]}, indent=2, ensure_ascii=False) + "\n"
