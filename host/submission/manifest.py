"""``submission.json``: a submission's account of itself, as types; published as a JSON Schema as well.

Units stand in the names, the order of fields and trials is fixed, so that two submissions can be compared by ``diff``.
"""

from __future__ import annotations

import msgspec

from analysis.reporting.tables import SummaryRow
from analysis.scoring.result import schema_text

SUBMISSION_FORMAT = 1
"""Version of the layout; a reader refuses others."""
SCORE_VERSION = "1"
"""Version of the whole path from samples to numbers. It rises when the same recording would score otherwise."""
CARD = "RAL-SI-2020-B19-0838.4-V1.0"
"""The benchmark card that is followed."""

CONVENTIONS = {
    "quaternion": "unit, w x y z, Hamilton, object to world",
    "difference": "left, world frame: q_(i+1) * inv(q_i)",
    "average": "eigenvector of the largest eigenvalue of the sum of outer products",
    "end_points": "one per cycle, always at the same extreme",
}
"""What a reader needs to know to compute the same number."""


Scalar = str | int | float | bool | None
CardValue = Scalar | list[Scalar | dict[str, Scalar]] | dict[str, Scalar]
"""What stands in a field of a card: a value, several, or a small table (dimensions, weights)."""


class RawFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The recording inside the bundle."""

    name: str
    bytes: int
    sha256: str


class TrialEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One trial: the numbers that are compared, and the cards."""

    id: str
    hand: str
    object: str
    motion: str
    valid: bool
    theta_bar_deg: float | None
    interval_low_deg: float | None
    interval_high_deg: float | None
    n_endpoints: int
    period_s: float | None
    mean_step_deg: float | None
    drift_axis: list[float] | None
    theta_bar_other_extreme_deg: float | None
    translation_drift_mm: float | None
    sensor_per_cycle_deg: float | None
    sensor_floor_deg: float | None
    reasons: list[str]
    warnings: list[str]
    convention: str
    cards: dict[str, dict[str, CardValue]]
    missing: list[str]
    raw: RawFile

    @property
    def interval_deg(self) -> tuple[float, float] | None:
        """Both ends of the interval; None where there is none."""
        low, high = self.interval_low_deg, self.interval_high_deg
        return None if low is None or high is None else (low, high)


class Submission(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Everything in ``submission.json``."""

    format: int
    card: str
    score_version: str
    title: str
    complete: bool
    conventions: dict[str, str]
    made_with: dict[str, str]
    summary: list[SummaryRow]
    trials: list[TrialEntry]


def submission_json(submission: Submission) -> bytes:
    """Return ``submission.json``: indented, in the order of the types, full precision."""
    return msgspec.json.format(msgspec.json.encode(submission), indent=1) + b"\n"


def parse_submission(data: bytes) -> Submission:
    """Read ``submission.json``.

    Raises
    ------
    ValueError
        Not JSON, another format, or a field that is missing, unknown or of the wrong kind; the message names it.
    """
    try:
        submission = msgspec.json.decode(data, type=Submission)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"submission.json: {error}") from error
    if submission.format != SUBMISSION_FORMAT:
        raise ValueError(f"submission.json has format {submission.format}, this program knows {SUBMISSION_FORMAT}")
    return submission


def submission_schema() -> str:
    """Return the JSON Schema (2020-12) of ``submission.json``."""
    return schema_text(Submission, "rotdrift submission")
