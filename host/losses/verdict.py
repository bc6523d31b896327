"""What missing samples mean for a score: which cycles have gaps, and from when on the score is called degraded."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from host.losses.ledger import LossReport

LOSS_LIMIT = 0.01
"""Share of missing samples of a whole trial from which its score is degraded."""
CYCLE_LOSS_LIMIT = 0.05
"""Share of missing samples of one cycle from which it counts as a cycle with a gap."""
GAP_CYCLES_LIMIT = 0.25
"""Share of cycles with a gap from which the score is degraded."""


@dataclass(frozen=True, slots=True)
class CycleLosses:
    """The account of one cycle; ``produced == received + lost + rejected + dropped_by_device``."""

    produced: int
    missing: int
    """Of these, samples that are not here."""
    rejected: int
    """Of the missing, those that arrived damaged."""
    dropped_by_device: int
    """Of the missing, those that the device dropped."""

    def to_json(self) -> dict[str, int]:
        """Return plain values, with what follows from them."""
        lost = self.missing - self.rejected - self.dropped_by_device
        return {
            "produced": self.produced,
            "missing": self.missing,
            "rejected": self.rejected,
            "dropped_by_device": self.dropped_by_device,
            "received": self.produced - self.missing,
            "lost": lost,
        }


@dataclass(frozen=True, slots=True)
class LossVerdict:
    """What the losses of one trial come to."""

    degraded: bool
    """Whether more is missing than a good trial may miss. There is a score all the same."""
    reasons: tuple[str, ...]
    """Why, a sentence each; empty where nothing is degraded."""
    cycles_with_gaps: tuple[int, ...]
    """Cycles, from 1, of which more than :data:`CYCLE_LOSS_LIMIT` is missing."""
    limits: tuple[float, float, float] = (LOSS_LIMIT, CYCLE_LOSS_LIMIT, GAP_CYCLES_LIMIT)
    """The limits that were applied: of the trial, of a cycle, of the share of cycles with gaps."""

    def to_json(self) -> dict[str, Any]:
        """Return plain values."""
        return asdict(self)


def judge_losses(losses: LossReport, missing: list[int], expected: list[int]) -> LossVerdict:
    """Judge a trial by what is missing.

    Parameters
    ----------
    losses : LossReport
        Of the whole trial.
    missing : list of int
        Missing samples of each cycle, in order.
    expected : list of int
        Samples each cycle should have, as long as ``missing``.
    """
    gaps = tuple(
        number
        for number, (gone, whole) in enumerate(zip(missing, expected, strict=True), start=1)
        if gone > CYCLE_LOSS_LIMIT * whole
    )
    reasons = []
    if losses.share > LOSS_LIMIT:
        reasons.append(
            f"{100 * losses.share:.1f} % of the samples are missing ({losses.lost} lost on the link, "
            f"{losses.rejected} damaged, {losses.dropped} dropped by the object): the score is degraded"
        )
    if missing and len(gaps) > GAP_CYCLES_LIMIT * len(missing):
        reasons.append(
            f"{len(gaps)} of {len(missing)} cycles miss more than {100 * CYCLE_LOSS_LIMIT:.0f} % of their samples "
            f"(cycle {', '.join(map(str, gaps[:8]))}{', ...' if len(gaps) > 8 else ''}): the score is degraded"
        )
    return LossVerdict(bool(reasons), tuple(reasons), gaps)
