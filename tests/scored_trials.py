"""Scored trials for the tests of reporting: a simulated motion and its score as JSON values."""

import json

from analysis.reporting.trial_report import CardRow, CardTable, TrialReport
from analysis.scoring.trial import score_series
from tests.simulated_motion import simulate, trapezoid


def scored(**settings):
    """A series of twelve cycles with a slip, and its result after a way through JSON, as stored results come."""
    settings = {"cycles": 12, "noise_deg": 0.05, "slip_cycle": 6, "slip_deg": 2.0, **settings}
    series = simulate(trapezoid, **settings).series
    return series, result_of(series)


def result_of(series):
    return json.loads(json.dumps(score_series(series).to_json()))


def trial_report(name="t42--cube--roll--01", hand="T42", motion="roll", comments="fine", **settings):
    series, result = scored(**settings)
    return TrialReport(
        id=name,
        hand=hand,
        object="cube 60 × 60 × 60 mm",
        motion=motion,
        series=series,
        result=result,
        cards=(
            CardTable("Object", (CardRow("type", "cube", required=True), CardRow("mass", "", required=True))),
            CardTable("Hand", (CardRow("model", hand, required=True), CardRow("maker", ""))),
        ),
        comments=comments,
        missing=("object.mass_g",),
        notes=("a note",),
        provenance=(("recording", "roll.mcap"), ("SHA-256", "0" * 64)),
        losses={"received": 1000, "lost": 3},
    )
