"""Scored trials for the tests of reporting: a simulated motion and its result."""

from msgspec import structs

from analysis.reporting.trial_report import CardRow, CardTable, TrialReport
from analysis.scoring.recorded_parts import Losses
from analysis.scoring.result import parse_result, result_text
from analysis.scoring.trial import score_series
from tests.simulated_motion import simulate, trapezoid


def scored(**settings):
    """A series of twelve cycles with a slip, and its result after a way through JSON, as stored results come."""
    settings = {"cycles": 12, "noise_deg": 0.05, "slip_cycle": 6, "slip_deg": 2.0, **settings}
    series = simulate(trapezoid, **settings).series
    return series, parse_result(result_text(score_series(series)).encode())


LOSSES = Losses(
    produced=1003,
    received=1000,
    lost=3,
    rejected=0,
    duplicates=0,
    reordered=0,
    segments=1,
    exact=True,
    dropped_by_device=0,
    missing=3,
    share=0.00299,
)


def trial_report(name="t42--cube--roll--01", hand="T42", motion="roll", comments="fine", **settings):
    series, result = scored(**settings)
    return TrialReport(
        id=name,
        hand=hand,
        object="cube 60 × 60 × 60 mm",
        motion=motion,
        series=series,
        result=structs.replace(result, losses=LOSSES),
        cards=(
            CardTable("Object", (CardRow("type", "cube", required=True), CardRow("mass", "", required=True))),
            CardTable("Hand", (CardRow("model", hand, required=True), CardRow("maker", ""))),
        ),
        comments=comments,
        missing=("object.mass_g",),
        notes=("a note",),
        provenance=(("recording", "roll.mcap"), ("SHA-256", "0" * 64)),
    )
