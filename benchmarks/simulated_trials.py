"""Trials as the rigs' recordings show them, drawn at random with a known answer: what is refused, missed, invented.

``python -m benchmarks.simulated_trials [TRIALS]``; the exit code is 1 where more than 1 % are refused or wrong.

Periods of 1 to 20 s, swings of 3 to 60°, 5 to 14 cycles; rests at none, one or both ends of the swing, a shelf or a
second hump on the way, strokes that stick and slip, motion about a second axis, uneven tempo and size, drift up to 15 %
of the swing per cycle, noise. Before and after: rest, a start in the middle of the range, the object put in place,
dropped by up to 60° or the recording cut off. 100 or 240 Hz, lost samples, one gap, outliers, samples that repeat the
one before, or every sample twice. It also shows how near these trials come
to the limits that refuse: limits chosen with a few recordings at hand must not be near.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from analysis.cycles.search import CycleAnalysis, CycleSettings, find_cycles
from analysis.series import FloatArray, OrientationSeries

LIMIT = 0.01
TOLERANCE = 0.12
"""An end point is found when it is as near to a true one, less the constant phase offset, periods."""
_POINTS = 2000


@dataclass(frozen=True, eq=False)
class Draw:
    """One simulated trial and its true extremes."""

    series: OrientationSeries
    what: str
    upper_s: FloatArray
    lower_s: FloatArray

    @property
    def period_s(self) -> float:
        return float(np.median(np.diff(self.upper_s)))


def _smooth_step(x: FloatArray) -> FloatArray:
    x = np.clip(x, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


def _shape(rng: np.random.Generator) -> tuple[FloatArray, float, str]:
    """One cycle from low to low over _POINTS points, the phase of its high, and what it is."""
    high, low = (float(rng.choice([0.0, 0.1, 0.2, 0.35]) * rng.uniform(0.5, 1.0)) for _ in range(2))
    rise = (1.0 - high - low) * rng.uniform(0.3, 0.7)
    phases, values = [0.0, low / 2.0], [0.0, 0.0]
    kind = str(rng.choice(["plain", "plain", "shelf", "hump", "steps"]))
    if kind == "hump":
        top = float(rng.choice([0.4, 0.6, 0.8]))
        phases += [phases[-1] + 0.35 * rise, phases[-1] + 0.6 * rise]
        values += [top, top * rng.uniform(0.1, 0.5)]
    elif kind == "shelf":
        level, length = rng.uniform(0.3, 0.7), rng.choice([0.1, 0.2])
        phases += [phases[-1] + (0.5 - length / 2.0) * rise, phases[-1] + (0.5 + length / 2.0) * rise]
        values += [level, 1.02 * level]
    top_phase = low / 2.0 + rise
    phases += [top_phase, top_phase + high, 1.0 - low / 2.0, 1.0]
    values += [1.0, 1.0 + rng.uniform(-0.03, 0.03), 0.0, 0.0]
    cycle = np.interp(np.arange(_POINTS) / _POINTS, phases, values)
    sigma = float(rng.choice([0.01, 0.03, 0.06])) * _POINTS
    if kind == "steps":
        steps, share = int(rng.integers(4, 10)), rng.uniform(0.3, 0.95)
        cycle = (1.0 - share) * cycle + share * np.round(cycle * steps) / steps
        sigma = 0.005 * _POINTS
    return gaussian_filter1d(cycle, sigma, mode="wrap"), top_phase + high / 2.0, f"{kind}, rests {high:.2f} {low:.2f}"


def draw(seed: int) -> Draw:
    """Draw a trial; a pure function of the seed."""
    rng = np.random.default_rng(seed)
    cycles, rate_hz = int(rng.integers(5, 15)), float(rng.choice([100.0, 240.0]))
    period_s, swing = float(np.exp(rng.uniform(0.0, np.log(20.0)))), float(np.exp(rng.uniform(np.log(3), np.log(60))))
    cycle, top_phase, shape = _shape(rng)
    start, end = str(rng.choice(["rest", "middle", "placed"])), str(rng.choice(["rest", "dropped", "cut"]))
    lengths_s = period_s * (1.0 + rng.choice([0.0, 0.01, 0.03, 0.06]) * rng.normal(size=cycles).clip(-2.0, 2.0))
    sizes = 1.0 + rng.choice([0.0, 0.03, 0.08]) * rng.normal(size=cycles).clip(-2.0, 2.0)
    begins_s = np.concatenate(([0.0], np.cumsum(lengths_s)))
    lead_s, rest_s = 2.0 + rng.uniform(0.0, 6.0), rng.uniform(0.0, 6.0)
    tail_s = -0.3 * period_s * rng.uniform() if end == "cut" else 2.0 + rest_s
    times_s = np.arange(int((lead_s + begins_s[-1] + tail_s) * rate_hz)) / rate_hz
    local_s = times_s - lead_s
    k = np.clip(np.searchsorted(begins_s, local_s, side="right") - 1, 0, cycles - 1)
    part = np.clip((local_s - begins_s[k]) / lengths_s[k], 0.0, 1.0)
    angle = sizes[k] * np.interp(part, np.arange(_POINTS + 1) / _POINTS, np.append(cycle, cycle[0]))
    if start == "middle":
        angle[: np.searchsorted(local_s, 0.5 * top_phase * lengths_s[0])] = np.interp(
            0.5 * top_phase, np.arange(_POINTS) / _POINTS, cycle
        )
    side, times_a_cycle, offset = rng.choice([0.0, 0.1, 0.3, 0.6]), int(rng.choice([1, 1, 2])), rng.uniform(0.0, 6.3)
    across = 0.5 * side * (np.cos(2.0 * np.pi * times_a_cycle * part + offset) - np.cos(offset))
    steps = rng.choice([0.0, 0.01, 0.05, 0.15]) * _unit(rng) + rng.choice([0.0, 0.01, 0.03]) * rng.normal(
        size=(cycles, 3)
    )
    creep = (
        np.concatenate((np.zeros((1, 3)), np.cumsum(steps, axis=0)))[k]
        + _smooth_step((part - 0.7) / 0.2)[:, None] * (steps[k])
    )
    axis = _unit(rng)
    second = np.cross(axis, _unit(rng))
    second /= np.linalg.norm(second)
    turn = np.radians(swing)
    poses = Rotation.from_rotvec(turn * creep) * Rotation.from_rotvec(
        turn * (angle[:, None] * axis + across[:, None] * second)
    )
    if start == "placed":
        stroke = turn * rng.uniform(0.3, 1.5) * _unit(rng)
        poses = Rotation.from_rotvec((1.0 - _smooth_step((times_s - 0.2) / 1.2))[:, None] * stroke) * poses
    if end == "dropped":
        stroke = np.radians(rng.uniform(5.0, 60.0)) * _unit(rng)
        poses = Rotation.from_rotvec(_smooth_step((local_s - begins_s[-1] - rest_s) / 0.4)[:, None] * stroke) * poses
    noise = np.radians(rng.choice([0.005, 0.02, 0.05])) * rng.normal(size=(len(times_s), 3))
    quats = (Rotation.from_rotvec(noise) * poses * Rotation.from_rotvec(rng.normal(size=3))).as_quat(scalar_first=True)
    times_s, quats, link = _link(rng, times_s, quats, (lead_s, begins_s[-1], period_s))
    seen = slice(None, -1) if end == "cut" else slice(None)
    what = f"{shape}; T {period_s:.1f} s, {swing:.0f}°, second axis {side}×{times_a_cycle}, {start}, {end}, {link}"
    return Draw(
        OrientationSeries(times_s, quats, np.arange(len(times_s))),
        what,
        (lead_s + begins_s[:-1] + top_phase * lengths_s)[seen],
        lead_s + begins_s[1:-1],
    )


def _unit(rng: np.random.Generator) -> FloatArray:
    axis = rng.normal(size=3)
    return np.asarray(axis / np.linalg.norm(axis))


def _link(
    rng: np.random.Generator, times_s: FloatArray, quats: FloatArray, trial: tuple[float, float, float]
) -> tuple[FloatArray, FloatArray, str]:
    """Lose a tenth, leave a gap of up to 0.3 periods, let single samples be wrong or repeated, or deliver all twice."""
    lead_s, length_s, period_s = trial
    kind = str(rng.choice(["whole", "whole", "loss", "gap", "twice", "outliers", "repeats"]))
    if kind == "twice":
        doubled = np.repeat(times_s, 2)
        doubled[1::2] += 5e-5
        return doubled, np.repeat(quats, 2, axis=0), kind
    keep = np.ones(len(times_s), dtype=bool)
    hit = rng.random(len(times_s)) < 0.002
    if kind == "outliers":
        wrong_by = Rotation.from_rotvec(np.radians(10.0) * hit[:, None] * rng.normal(size=(len(hit), 3)))
        quats = (wrong_by * Rotation.from_quat(quats, scalar_first=True)).as_quat(scalar_first=True)
    elif kind == "repeats":
        quats = quats[np.arange(len(hit)) - hit * np.minimum(np.arange(len(hit)), 1)]
    elif kind == "loss":
        keep = rng.random(len(times_s)) > 0.1
    elif kind == "gap":
        middle_s = lead_s + rng.uniform(0.1, 0.9) * length_s
        keep = np.abs(times_s - middle_s) > 0.05 * period_s * rng.uniform(0.5, 3.0)
    return times_s[keep], quats[keep], kind


def wrong(trial: Draw, found: CycleAnalysis) -> tuple[int, int]:
    """Count missed and extra end points between the second and the last but one of the truth, the better extreme."""
    best = (len(trial.upper_s), 0)
    for points in (found.endpoints, found.other_endpoints):
        for truth_s in (trial.upper_s, trial.lower_s):
            times_s = np.array([point.time_s for point in points])
            if not len(times_s) or len(truth_s) < 3:
                continue
            away = times_s[:, None] - truth_s
            times_s -= np.median(away[np.arange(len(times_s)), np.abs(away).argmin(axis=1)])
            inner_s, reach_s = truth_s[1:-1], TOLERANCE * trial.period_s
            inside_s = times_s[(times_s > inner_s[0] - 2.5 * reach_s) & (times_s < inner_s[-1] + 2.5 * reach_s)]
            missed = int(sum(np.abs(times_s - at_s).min() > reach_s for at_s in inner_s))
            extra = int(sum(np.abs(inner_s - at_s).min() > reach_s for at_s in inside_s))
            best = min(best, (missed, extra), key=sum)
    return best


def main(trials: int = 400) -> int:
    settings, refused, bad, periods = CycleSettings(), 0, 0, 0
    likeness, irregularity = [], []
    for seed in range(trials):
        trial = draw(seed)
        found = find_cycles(trial.series)
        likeness.append(found.likeness)
        irregularity.append(found.irregularity)
        if not found.valid:
            refused += 1
            print(f"refused {seed}: {'; '.join(found.reasons)} ({trial.what})", flush=True)
            continue
        missed, extra = wrong(trial, found)
        periods += abs(found.period_s / trial.period_s - 1.0) > 0.02
        if missed + extra:
            bad += 1
            print(f"wrong {seed}: {missed} missed, {extra} extra ({trial.what})", flush=True)
    print(
        f"{trials} trials: {refused} refused, {bad} with an end point missed or extra, {periods} periods off by > 2 %"
    )
    print(
        f"likeness: least {min(likeness):.2f}, 1 % below {np.percentile(likeness, 1):.2f} "
        f"(refused below {settings.min_likeness}); irregularity: largest {max(irregularity):.2f}, 1 % above "
        f"{np.percentile(irregularity, 99):.2f} (refused above {settings.max_irregularity})"
    )
    return 0 if refused + bad <= LIMIT * trials else 1


if __name__ == "__main__":
    sys.exit(main(*(int(text) for text in sys.argv[1:2])))
