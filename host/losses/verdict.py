"""What missing samples mean for a score: which cycles have gaps, and from when on the score is called degraded."""

from __future__ import annotations

from collections.abc import Sequence

from analysis.scoring.recorded_parts import CycleLosses, Quality
from host.losses.ledger import LossReport

LOSS_LIMIT = 0.01
"""Share of missing samples of a whole trial from which its score is degraded."""
CYCLE_LOSS_LIMIT = 0.05
"""Share of missing samples of one cycle from which it counts as a cycle with a gap."""
GAP_CYCLES_LIMIT = 0.25
"""Share of cycles with a gap from which the score is degraded."""


def judge_losses(losses: LossReport, cycles: Sequence[CycleLosses]) -> Quality:
    """Return what the missing samples of a trial come to.

    Parameters
    ----------
    losses : LossReport
        Of the whole trial.
    cycles : sequence of CycleLosses
        Of each cycle, in order.
    """
    gaps = tuple(
        number for number, cycle in enumerate(cycles, start=1) if cycle.missing > CYCLE_LOSS_LIMIT * cycle.produced
    )
    reasons = []
    if losses.share > LOSS_LIMIT:
        in_file = f", {losses.damaged_in_file} damaged in the file" if losses.damaged_in_file else ""
        reasons.append(
            f"{100 * losses.share:.1f} % of the samples are missing ({losses.lost} lost on the link, "
            f"{losses.rejected} damaged, {losses.dropped} dropped by the object{in_file}): the score is degraded"
        )
    if cycles and len(gaps) > GAP_CYCLES_LIMIT * len(cycles):
        reasons.append(
            f"{len(gaps)} of {len(cycles)} cycles miss more than {100 * CYCLE_LOSS_LIMIT:.0f} % of their samples "
            f"(cycle {', '.join(map(str, gaps[:8]))}{', ...' if len(gaps) > 8 else ''}): the score is degraded"
        )
    return Quality(bool(reasons), tuple(reasons), gaps, (LOSS_LIMIT, CYCLE_LOSS_LIMIT, GAP_CYCLES_LIMIT))
