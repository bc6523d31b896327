"""Every acceptance figure of the search for cycles on the authors' recordings, with its goal beside it.

``python -m benchmarks.recordings_table`` prints the tables; the exit code is 1 where a goal is missed. The recordings
are found through ROTDRIFT_RECORDINGS, else beside the repository. The authors' own end points are the reference: they
were chosen by their scripts, with constants set by hand for every file. In each of these recordings they are the maxima
of one position channel, so they need not be extremes of the rotation.

Goals that are a share of recordings are meant for all ``ALL_RECORDINGS``, most of which are kept aside. Where too few
are here to decide, and those that miss are known and explained, such a goal is marked ``open``, never ``ok``.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.cycles.online.detector import OnlineCycleDetector
from analysis.cycles.search import CycleAnalysis, Endpoint, find_cycles
from analysis.formats import read_series
from analysis.geometry import rotations
from analysis.scoring.card import rotation_drift
from analysis.scoring.trial import score_series
from analysis.series import FloatArray, OrientationSeries

FOLDER = Path(os.environ.get("ROTDRIFT_RECORDINGS", Path(__file__).resolve().parents[2] / "shared" / "recordings"))

ALL_RECORDINGS = 19
"""Those with end points of the authors, shared and kept aside together: what the shares of recordings are meant of."""
KNOWN_MISSES = {
    "T42_cylinder_z_1.csv": (
        "the authors' end points are the maxima of tx; the first of the four lies 0.4° of rotation before the plateau "
        "that the other three reach, and θ̄ of three steps hangs on it: with the authors' first point alone ours gives "
        "0.23°, theirs without it 0.44°. Dwell depths from 0.5 to 30 % of the swing, wider averages and the extreme "
        "of the position along its own main axis all give 0.39 to 0.41°"
    ),
}
"""Recordings whose θ̄ on the same cycles is known to lie outside the goal, and why."""


@dataclass(frozen=True)
class Agreement:
    """One recording: what was found inside the authors' window against the authors' own end points."""

    name: str
    period_error: float
    missed: int
    extra: int
    authors: int
    offset: float
    scatter: float
    theta_deg: float
    theta_aligned_deg: float
    theta_authors_deg: float

    @property
    def theta_close(self) -> bool:
        return abs(self.theta_deg - self.theta_authors_deg) <= max(0.05, 0.1 * self.theta_authors_deg)


@dataclass(frozen=True)
class Causal:
    """One recording: the online search against the offline one. Times in periods."""

    name: str
    missed: int
    extra: int
    offline: int
    time_error: FloatArray
    latency: FloatArray
    microseconds: float
    theta_difference_deg: float


@dataclass(frozen=True)
class Goal:
    """A figure and what it has to be."""

    what: str
    value: str
    goal: str
    met: bool | None
    """None: cannot be decided from the recordings that are here."""

    @property
    def mark(self) -> str:
        return {True: "ok", False: "MISS", None: "open"}[self.met]


def recordings() -> dict[str, tuple[OrientationSeries, dict[str, object] | None]]:
    """All shared recordings by name, with the authors' end points where there are any."""
    reference = json.loads((FOLDER / "endpoints.json").read_text())["recordings"]
    return {path.name: (read_series(path), reference.get(path.name)) for path in sorted(FOLDER.rglob("*.csv"))}


def theta_deg(endpoints: tuple[Endpoint, ...] | list[Endpoint]) -> float:
    return rotation_drift(np.array([point.quat_wxyz for point in endpoints])).theta_bar_deg


def agreement(name: str, series: OrientationSeries, reference: dict[str, object]) -> Agreement:
    """Compare inside the window from the authors' first to their last end point, 0.3 periods wider at both ends."""
    rows = np.array(reference["endpoints_row"])
    authors_s = np.array([series.sample(int(row)).time_s for row in rows])
    period_s = float(np.mean(np.diff(authors_s)))
    found = find_cycles(series)
    choices = []
    for points in (found.endpoints, found.other_endpoints):  # the authors chose an extreme; the primary is ours
        inside = [p for p in points if authors_s[0] - 0.3 * period_s < p.time_s < authors_s[-1] + 0.3 * period_s]
        times_s = np.array([point.time_s for point in inside])
        nearest = np.array([int(np.argmin(np.abs(times_s - at_s))) for at_s in authors_s])
        error = (times_s[nearest] - authors_s) / period_s
        choices.append((abs(float(np.median(error))), inside, nearest, error))
    _, inside, nearest, error = min(choices, key=lambda choice: choice[0])
    matched = np.unique(nearest[np.abs(error - np.median(error)) < 0.1])
    chosen = [inside[k] for k in matched]
    offset = float(np.median(error))
    aligned = [_nearest_quat(series, point.time_s - offset * period_s) for point in chosen]
    return Agreement(
        name=name,
        period_error=found.period_s / period_s - 1.0,
        missed=len(rows) - len(matched),
        extra=len(inside) - len(matched),
        authors=len(rows),
        offset=offset,
        scatter=float(np.std(error)),
        theta_deg=theta_deg(chosen),
        theta_aligned_deg=rotation_drift(np.array(aligned)).theta_bar_deg,
        theta_authors_deg=float(str(reference["theta_bar_deg"])),
    )


def automatic_rows() -> list[str]:
    """Return the rows of the table on the benchmark page: θ̄ of the automatic window beside that of the authors."""
    rows = []
    for name, (series, reference) in recordings().items():
        if reference is None:
            continue
        automatic, item = score_series(series), agreement(name, series, reference)
        rows.append(
            f"| {name.removesuffix('.csv')} | {automatic.theta_bar_deg:.3f}° ({automatic.n_endpoints}) "
            f"| {item.theta_authors_deg:.3f}° ({item.authors}) "
            f"| {(automatic.theta_bar_deg or 0.0) - item.theta_authors_deg:+.3f}° | {item.theta_deg:.3f}° |"
        )
    return rows


def _nearest_quat(series: OrientationSeries, time_s: float) -> FloatArray:
    return np.asarray(series.quats_wxyz[int(np.argmin(np.abs(series.times_s - time_s)))])


def causal(name: str, series: OrientationSeries, offline: CycleAnalysis) -> Causal:
    """Feed sample by sample and note when each end point is known."""
    detector = OnlineCycleDetector()
    known: list[tuple[Endpoint, float]] = []
    withdrawn = 0
    times_s, quats = series.times_s.tolist(), series.quats_wxyz
    started = time.process_time()
    for k, at_s in enumerate(times_s):
        new = detector.feed([at_s], quats[k : k + 1])
        if new:
            if detector.state.withdrawn > withdrawn:
                known, withdrawn = [], detector.state.withdrawn
            known += [(point, at_s) for point in new]
    seconds = time.process_time() - started
    online_s = np.array([point.time_s for point, _ in known])
    offline_s = np.array([point.time_s for point in offline.endpoints])
    period_s = offline.period_s
    error = np.abs(offline_s[:, None] - online_s).min(axis=1) / period_s
    beyond = np.abs(online_s[:, None] - offline_s).min(axis=1) / period_s
    # Turning points that the offline gates take off at the two ends are no errors of a search that cannot look ahead.
    between = (online_s > offline_s[0] - 0.5 * period_s) & (online_s < offline_s[-1] + 0.5 * period_s)
    return Causal(
        name=name,
        missed=int((error > 0.1).sum()),
        extra=int(((beyond > 0.1) & between).sum()),
        offline=len(offline_s),
        time_error=error[error <= 0.1],
        latency=np.array([(at_s - point.time_s) / period_s for point, at_s in known]),
        microseconds=1e6 * seconds / len(times_s),
        theta_difference_deg=abs(
            theta_deg([p for (p, _), keep in zip(known, between, strict=True) if keep]) - theta_deg(offline.endpoints)
        ),
    )


def disturbed(series: OrientationSeries, seed: int) -> Iterator[tuple[str, OrientationSeries, float | None]]:
    """The recording as it must still give the same: what was done, and how far θ̄ may move, deg (None: not at all)."""
    rng = np.random.default_rng(seed)
    quats, n = series.quats_wxyz, len(series)

    def other(quats_wxyz: FloatArray, rows: FloatArray | slice = slice(None)) -> OrientationSeries:
        return OrientationSeries(series.times_s[rows], quats_wxyz[rows], series.index[rows])

    turn = rotations.exp(rng.normal(size=(2, 3)))
    yield "signs flipped", other(quats * rng.choice([-1.0, 1.0], size=(n, 1))), 1e-12
    yield "another world frame", other(rotations.multiply(turn[0], quats)), 1e-8
    yield "another mounting", other(rotations.multiply(quats, turn[1])), 1e-8
    yield "float32", other(quats.astype(np.float32).astype(np.float64)), 0.002
    yield "int16", other(np.round(quats * 32767.0) / 32767.0), 0.002
    yield "a tenth lost", other(quats, np.flatnonzero(rng.random(n) > 0.1)), 0.005
    noise = rotations.exp(np.radians(0.1) * rng.normal(size=(n, 3)))
    yield "noise of 0.1°", other(rotations.multiply(noise, quats)), 0.05
    heading = np.zeros((n, 3))
    heading[:, 2] = np.radians(1.0 / 60.0) * (series.times_s - series.times_s[0])
    yield "heading drift of 1°/min", other(rotations.multiply(rotations.exp(heading), quats)), None


def invariances(series: OrientationSeries, found: CycleAnalysis, seed: int) -> dict[str, tuple[bool, float, float]]:
    """Whether the number of end points stays, how far θ̄ moves, and how far it may, deg."""
    result = {}
    for what, changed, limit in disturbed(series, seed):
        again = find_cycles(changed)
        same = len(again.endpoints) == len(found.endpoints) and again.valid
        moved = abs(theta_deg(again.endpoints) - theta_deg(found.endpoints)) if same else float("inf")
        result[what] = (same, moved, found.period_s / 60.0 + 0.005 if limit is None else limit)
    return result


def goals(
    agreed: list[Agreement], online: list[Causal], moved: list[dict[str, tuple[bool, float, float]]]
) -> list[Goal]:
    """All figures over the recordings."""
    n, points = len(agreed), sum(item.authors for item in agreed)
    clean = sum(item.missed == item.extra == 0 for item in agreed)
    wrong = sum(item.missed + item.extra for item in agreed)
    close = sum(item.theta_close for item in agreed)
    explained = all(item.theta_close or item.name in KNOWN_MISSES for item in agreed)
    worst_period = max(abs(item.period_error) for item in agreed)
    scatter = [item.scatter for item in agreed]
    rows = [
        Goal("period, worst", f"{worst_period:.2%}", "≤ 2 %", worst_period <= 0.02),
        _share("recordings without a missed or extra end point", clean, n, 0.90, explained=clean == n),
        Goal("end points missed or extra", f"{wrong} of {points}", "≤ 1 %", wrong <= 0.01 * points),
        _at_most("constant phase offset, worst, periods", max(abs(item.offset) for item in agreed), 0.12),
        _at_most("scatter around the authors', worst, periods", max(scatter), 0.025),
        _at_most("scatter around the authors', median, periods", float(np.median(scatter)), 0.01),
        _share("θ̄ on the same cycles within max(0.05°, 10 %)", close, n, 0.85, explained=explained),
    ]
    offline = sum(item.offline for item in online)
    wrong = sum(item.missed + item.extra for item in online)
    errors = np.concatenate([item.time_error for item in online])
    late = np.concatenate([item.latency for item in online])
    rows += [
        Goal("online: missed or extra against offline", f"{wrong} of {offline}", "≤ 1 %", wrong <= 0.01 * offline),
        _at_most("online: time difference, median, periods", float(np.median(errors)), 0.005),
        _at_most("online: latency, median, periods", float(np.median(late)), 0.25),
        _at_most("online: latency, worst, periods", float(late.max()), 0.40),
        _at_most("online: time per sample, worst, µs", max(item.microseconds for item in online), 100.0),
    ]
    for what in moved[0]:
        same = all(item[what][0] for item in moved)
        within = same and all(item[what][1] <= item[what][2] for item in moved)
        worst = max(item[what][1] for item in moved)
        limit = "rate·T + 0.005°" if "heading" in what else f"{moved[0][what][2]:.4g}°"
        rows.append(Goal(f"{what}: same count, θ̄ moves by", f"{worst:.2g}°", f"≤ {limit}", within))
    return rows


def _at_most(what: str, value: float, limit: float) -> Goal:
    return Goal(what, f"{value:.4f}" if limit < 10.0 else f"{value:.1f}", f"≤ {limit:g}", value <= limit)


def _share(what: str, good: int, of: int, share: float, *, explained: bool) -> Goal:
    """Judge a share of recordings.

    Met where it holds for those that are here; open where it does not, but all that miss are explained and the share
    of all recordings can still be reached; else missed.
    """
    still_possible = of - good <= (1.0 - share) * ALL_RECORDINGS
    undecided = of < ALL_RECORDINGS and explained and still_possible
    met = True if good >= share * of else None if undecided else False
    return Goal(what, f"{good} of {of}", f"≥ {share:.0%} of {max(of, ALL_RECORDINGS)}", met)


def measure() -> tuple[list[Agreement], list[Causal], list[dict[str, tuple[bool, float, float]]], CycleAnalysis]:
    """Everything, and the search in the grasp-and-release recording, which must claim nothing."""
    agreed, online, moved = [], [], []
    refused = None
    for seed, (name, (series, reference)) in enumerate(recordings().items()):
        found = find_cycles(series)
        if reference is None:
            refused = found
            continue
        agreed.append(agreement(name, series, reference))
        online.append(causal(name, series, found))
        moved.append(invariances(series, found, seed))
    if refused is None:
        raise FileNotFoundError(f"no grasp-and-release recording in {FOLDER}")
    return agreed, online, moved, refused


def main(write: Callable[[str], object] = print) -> int:
    if not (FOLDER / "endpoints.json").exists():
        write(f"no recordings in {FOLDER}; set ROTDRIFT_RECORDINGS to their folder")
        return 4
    agreed, online, moved, refused = measure()
    write(
        f"{'recording':34}{'period':>8}{'missed':>8}{'extra':>7}{'offset':>9}{'scatter':>9}"
        "   θ̄ found / at the authors' phase / authors"
    )
    for item in agreed:
        mark = "" if item.theta_close else "   outside max(0.05°, 10 %)"
        write(
            f"{item.name:34}{item.period_error:>8.2%}{item.missed:>8}{item.extra:>7}{item.offset:>8.3f}T"
            f"{item.scatter:>8.2%}T  {item.theta_deg:.4f}° / {item.theta_aligned_deg:.4f}° / "
            f"{item.theta_authors_deg:.4f}°{mark}"
        )
    write(
        f"\n{'online against offline':34}{'missed':>8}{'extra':>7}{'|dt|':>9}{'latency':>9}{'worst':>7}{'µs':>6}   |Δθ̄|"
    )
    for row in online:
        write(
            f"{row.name:34}{row.missed:>8}{row.extra:>7}{np.median(row.time_error):>8.3%}T"
            f"{np.median(row.latency):>8.2f}T{row.latency.max():>6.2f}T{row.microseconds:>6.0f}"
            f"   {row.theta_difference_deg:.4f}°"
        )
    table = goals(agreed, online, moved)
    claims = not refused.valid and any("grasp-and-release" in text for text in refused.warnings)
    table.append(Goal("grasp-and-release: warned of, nothing claimed", "yes" if claims else "no", "yes", claims))
    write("")
    for goal in table:
        write(f"{goal.mark:4} {goal.what:58}{goal.value:>12}   {goal.goal}")
    write("\nθ̄ of the automatic window, of the authors, their difference, ours on the authors' cycles (end points):")
    for line in automatic_rows():
        write(line)
    outside = [item for item in agreed if not item.theta_close]
    for item in outside:
        write(
            f"\n{item.name}: θ̄ {item.theta_deg:.3f}° against the authors' {item.theta_authors_deg:.3f}°: "
            f"{KNOWN_MISSES.get(item.name, 'not explained')}"
        )
    if any(goal.met is None for goal in table):
        write(f"open: {len(agreed)} of {ALL_RECORDINGS} recordings are here, too few to decide; not met on these alone")
    return 1 if any(goal.met is False for goal in table) else 0


if __name__ == "__main__":
    sys.exit(main())
