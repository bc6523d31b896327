"""Results as CSV, a row each: for a spreadsheet, for MATLAB's readtable, for pandas."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

from host.results.batch import BatchRow
from host.text import plain

COLUMNS = (
    "file", "valid", "theta_bar_deg", "interval_low_deg", "interval_high_deg", "cycles", "period_s", "swing_deg",
    "axis_x", "axis_y", "axis_z", "other_extreme_deg", "sensor_per_cycle_deg", "below_floor", "missing_share",
    "flagged_cycles", "warnings", "reasons", "session",
)  # fmt: skip
"""Names with units; a cell is empty where the value is not known or does not exist."""


def results_csv(rows: Sequence[BatchRow]) -> str:
    """Return a table with a header; decimal points, whatever the locale, and a file that failed with its reason."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: _cell(value) for name, value in _values(row).items()})
    return text.getvalue()


def _values(row: BatchRow) -> dict[str, object]:
    result = row.result
    if result is None:
        return {
            "file": plain(row.path),
            "valid": False,
            "reasons": plain(row.error or "", 400),
            "session": row.session,
        }
    low, high = result.interval_deg or (None, None)
    x, y, z = result.axis or (None, None, None)
    other, sensor, losses = result.other_extreme, result.sensor, result.losses
    return {
        "file": plain(row.path),
        "valid": result.valid,
        "theta_bar_deg": result.theta_bar_deg,
        "interval_low_deg": low,
        "interval_high_deg": high,
        "cycles": max(0, result.n_endpoints - 1),
        "period_s": result.period_s,
        "swing_deg": result.cycles.swing_deg,
        "axis_x": x,
        "axis_y": y,
        "axis_z": z,
        "other_extreme_deg": None if other is None else other.theta_bar_deg,
        "sensor_per_cycle_deg": None if sensor is None else sensor.per_cycle_deg,
        "below_floor": None if sensor is None else sensor.below_floor,
        "missing_share": None if losses is None else losses.share,
        "flagged_cycles": sum(bool(flags) for flags in result.flags),
        "warnings": plain("; ".join(result.warnings), 2000),
        "reasons": plain("; ".join(result.reasons), 2000),
        "session": row.session,
    }


def _cell(value: object) -> object:
    """Return a value as MATLAB and pandas read it; a text that a spreadsheet would run as a formula is quoted."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str) and value.startswith(("=", "+", "-", "@")):
        return f"'{value}"
    return value
