"""The result for people: the number first, then trust, then cycles; and the table of many."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from rich.cells import cell_len
from rich.console import Console

from analysis.scoring.choice import EndpointChoice
from analysis.scoring.result_parts import LeftOutPoint
from analysis.scoring.trial import score_series
from analysis.sensor.baseline import StaticBaseline
from analysis.series import OrientationSeries
from host.results.batch import BatchRow
from host.results.printout import MAX_ROWS, print_batch, print_score
from tests.simulated_motion import simulate


def shown(score, width=80):
    out = io.StringIO()
    print_score(score, Console(file=out, width=width, highlight=False))
    assert max(cell_len(line) for line in out.getvalue().splitlines()) <= width
    return out.getvalue()


@pytest.fixture(scope="module")
def score():
    trial = simulate(cycles=9, slip_deg=4.0, slip_cycle=4, noise_deg=0.02, lead_s=1.0)
    positions = np.outer(trial.series.times_s, [1e-4, 0.0, 0.0])  # 0.1 mm/s: 0.4 mm in a cycle of 4 s
    series = OrientationSeries(
        trial.series.times_s, trial.series.quats_wxyz, trial.series.index, positions_m=positions, notes=("a note",)
    )
    return score_series(series)


def test_cycles_come_first_then_trust_and_the_number_last(score):
    lines = shown(score).splitlines()
    assert lines[0].split()[:3] == ["cycle", "row", "time"]
    assert lines[-1].startswith(f"rotation drift θ̄ = {score.theta_bar_deg:.3f}° per cycle")
    assert "95 % interval" in lines[-1]
    assert lines[-2] == "cannot be distinguished from no drift: the interval touches 0"
    blank = lines.index("")
    assert blank - 1 == len(score.endpoints)
    names = [line.split("  ")[0] for line in lines[blank + 1 : -3] if line[:1].strip()]
    order = ["motion", "drift axis", "steps", "poses", "θ̄ without", "θ̄ at", "position", "sensor", "window", "read as"]
    assert [name for name in names if name != "note"] == order


def test_a_long_table_is_cut_and_names_how_to_see_all():
    found = score_series(simulate(cycles=40).series)
    lines = shown(found).splitlines()
    assert lines.index("") == 1 + MAX_ROWS + 1
    assert f"{len(found.endpoints) - MAX_ROWS} more (score --cycles all)" in lines[1 + MAX_ROWS // 2]
    out = io.StringIO()
    print_score(found, Console(file=out, width=80), max_rows=1000)
    assert out.getvalue().splitlines().index("") == 1 + len(found.endpoints)


def test_the_score_alone_is_the_last_line_alone(score):
    out = io.StringIO()
    print_score(score, Console(file=out, width=80), only_score=True)
    assert out.getvalue().splitlines() == shown(score).splitlines()[-2:]


def test_every_companion_is_shown(score):
    text, found = " ".join(shown(score, 400).split()), score.companions
    for part in (
        f"{len(score.endpoints) - 1} cycles ({len(score.endpoints)} end points)",
        f"confidence {score.cycles.period_confidence:.2f}",
        f"{score.cycles.axis_share:.0%} of it about one axis",
        f"mean {found.mean_step_deg:.3f}°, median {found.median_step_deg:.3f}°, dispersion {found.dispersion_deg:.3f}°",
        f"top eigenvalue share {found.top_eigenvalue_share:.4f}",
        f"net rotation {found.net_rotation_deg:.2f}°, at most {found.max_excursion_deg:.2f}° from the first",
        f"slope {found.slope_deg_per_cycle:.3f}° per cycle",
        f"the first end point {found.without_first_deg:.3f}°, the last {found.without_last_deg:.3f}°",
        "any one step {:.3f}° to {:.3f}°".format(*found.leave_one_out_deg),
        f"the other extreme {score.other_extreme.theta_bar_deg:.3f}°",
        f"any phase {found.over_phase_deg.min:.3f}° to {found.over_phase_deg.max:.3f}°",
        f"{found.axis_share:.0%} of the stepping is along it",
        "translation drift 0.400 mm per cycle",
        "a 6-axis IMU would add",
        "pose jump",
        "a note",
    ):
        assert part in text, part


def test_numbers_stay_whole_beside_a_long_reason():
    why = "hand paused; the automatic one lay in the pause, which is at the other end of the plateau"
    choice = EndpointChoice("row", (300.0, 700.0, 1100.0, 1500.0), ("", why, "", ""))
    lines = shown(score_series(simulate(cycles=9, lead_s=1.0).series, endpoints=choice)).splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("start"))
    assert lines[first + 1].split()[:6] == ["1", "700", "7.000", "s", "4.000", "s"]
    folded = [line[lines[first - 1].index("step") + 6 :].strip() for line in lines[first + 1 : lines.index("") - 2]]
    assert "".join(folded).replace(" ", "") == why.replace(" ", "")


def test_a_motion_with_several_peaks_a_cycle_is_named():
    found = score_series(simulate(cycles=9).series)
    assert "peaks a cycle" not in shown(found, 400)
    assert "2 peaks a cycle" in shown(replace(found, cycles=replace(found.cycles, humps=2)), 400)


def test_below_the_floor_stands_beside_the_number():
    series = simulate(cycles=9, drift_deg=0.02).series
    walk = StaticBaseline((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), 0.01, 0.0, 120.0, 12000)
    score = score_series(series, baseline=walk)
    assert shown(score).splitlines()[-1] == "below the sensor's floor: it cannot be distinguished from no drift at all"
    assert "a resting object would score less in 95 of 100" in " ".join(shown(score, 400).split())
    out = io.StringIO()
    print_batch([BatchRow(Path("a.csv"), score, None, 0)], Console(file=out, width=80))
    assert f"below floor {score.theta_bar_deg:.3f}°" in out.getvalue()


def test_the_window_says_who_chose_it_and_what_was_left_out():
    found = score_series(simulate(cycles=9, lead_s=1.0).series)
    left_out = tuple(LeftOutPoint(100.0 * k, f"last cycle: reason {k}") for k in range(6))
    text = " ".join(shown(replace(found, window=replace(found.window, left_out=left_out)), 400).split())
    first, last = found.endpoints[0].time_s, found.endpoints[-1].time_s
    assert f"window automatic, {first:.2f} s to {last:.2f} s; left out: 0.00 s, last cycle: reason 0; 100.00 s" in text
    assert "reason 3; 2 more" in text
    chosen = score_series(simulate(cycles=9, lead_s=1.0).series, window=(8.0, 30.0))
    text = " ".join(shown(chosen, 400).split())
    assert "window as given, 8.00 s to 30.00 s" in text
    assert f"automatic θ̄ {chosen.window.automatic.theta_bar_deg:.3f}°" in text
    picked = score_series(simulate(cycles=9, lead_s=1.0).series, endpoints=[300, 700, 1100, 1500])
    assert "window end points as given, 3.00 s to 15.00 s" in " ".join(shown(picked, 400).split())


def test_a_refusal_gives_its_reason_once():
    still = simulate(cycles=1, swing_deg=0.0, drift_deg=0.0, noise_deg=0.01).series
    score = score_series(still)
    assert len(score.reasons) == 1
    assert shown(score).splitlines()[-1].startswith("no score: ")


def test_text_of_files_is_never_markup():
    series = simulate(cycles=6).series
    odd = OrientationSeries(series.times_s, series.quats_wxyz, series.index, convention="[bold]x[/bold]\x1b[31m")
    text = shown(score_series(odd))
    assert "[bold]x[/bold]" in text
    assert "\x1b" not in text


@pytest.mark.parametrize(("width", "terminal"), [(80, True), (120, True), (80, False)])
def test_the_table_keeps_names_whole(score, width, terminal):
    rows = [
        BatchRow(Path("/data/NDX_A/NDX_A_rigid_cylinder_roll_1.csv"), score, None, 0),
        BatchRow(Path("/data/T42/bad.csv"), None, "line 3: 'x' is not a number", 4),
    ]
    out = io.StringIO()
    print_batch(rows, Console(file=out, width=width, force_terminal=terminal, no_color=True, highlight=False))
    text = out.getvalue()
    assert "NDX_A/NDX_A_rigid_cylinder_roll_1.csv" in text
    assert ("other end" in text) == (width >= 100 or not terminal)
    assert "bad.csv: line 3: 'x' is not a number" in text
    assert "1 of 2 recordings scored" in text
