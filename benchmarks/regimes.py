"""Motion of many kinds with a known answer: wrong periods, refused trials, random motions accepted as a trial.

``python -m benchmarks.regimes [TRIALS] [--first SEED] [--only REGIME ...]``: so many seeded trials of each regime (80),
a row each. Figures are given for seeds that no number of the search was chosen by: from 3000 on.

The regimes are written from words alone (one, two and three peaks a cycle, uneven tempo, decay, pauses, tremor, a
wandering axis, swings of 1.5 to 340°, 20 Hz to 2 kHz), independent of the emulator and of the search for cycles:
rotations come from scipy, and every trial is a pure function of regime and seed. What is asked of the result is its
period, its number of end points, and whether its interval covers the drift that was built in.
"""

from __future__ import annotations

import argparse
import sys
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

import analysis
from analysis.series import FloatArray, OrientationSeries

WRONG_BY = 0.15
"""Share by which a period is another one: half, twice and three halves are, a mean over uneven cycles is not."""
GRID = 720
"""Points on which the shape of a cycle is drawn."""


@dataclass(frozen=True)
class Regime:
    """How the trials of one kind are drawn: ranges from which each trial takes its own value."""

    peaks: tuple[float, ...] = (1.0,)
    """Heights of the peaks of a cycle, share of the swing."""
    widths: tuple[float, ...] = ()
    """Shares of the cycle that the peaks last; even where empty."""
    lower: tuple[float, float] = (1.0, 1.0)
    """Range of a factor on all peaks but the first."""
    rest: tuple[float, float] = (0.0, 0.2)
    """Share of a peak that is spent at its top and bottom."""
    across: tuple[float, float] = (0.0, 0.15)
    """Turn about a second axis, share of the swing, with a shape of its own over the whole cycle."""
    swing_deg: tuple[float, float] = (10.0, 60.0)
    period_s: tuple[float, float] = (1.5, 8.0)
    cycles: tuple[int, int] = (5, 20)
    rate_hz: tuple[float, ...] = (100.0, 200.0)
    tempo: float = 0.02
    """Scatter of the length of a cycle, share."""
    speeding: float = 0.0
    """Change of tempo over the trial: the last cycle takes 1 − speeding of the first."""
    size: float = 0.02
    """Scatter of the swing, share."""
    growth: tuple[float, float] = (0.0, 0.0)
    """Change of the swing a cycle, share: negative shrinks."""
    pauses: float = 0.0
    """Chance of a pause after a cycle."""
    regrasp_deg: float = 0.0
    """Jump of the pose in a pause, about any axis."""
    grasp_deg: float = 0.0
    """Jump of the pose in the first and in the last cycle, about any axis; these two last 0.6 to 1.5 times as long."""
    tremor_deg: float = 0.0
    """Amplitude at 8 Hz."""
    wander_deg: float = 0.0
    """How far the motion axis moves over the trial."""
    drift_deg: tuple[float, float] = (0.0, 2.0)
    scatter_deg: tuple[float, float] = (0.0, 0.3)
    """Scatter of a step about the drift, each axis."""
    noise_deg: tuple[float, float] = (0.0, 0.03)
    """Of a sample, white."""
    pose_noise_deg: float = 0.0
    """Of the pose of a whole cycle: it comes and goes, so that steps correlate negatively."""
    judged: bool = True
    """Whether wrong and refused ones count: two peaks that nothing separates have no right answer."""


PLAIN = Regime()
REGIMES: dict[str, Regime] = {
    "one peak": PLAIN,
    "one peak, long rests": replace(PLAIN, rest=(0.3, 0.6)),
    "one peak, slow up and quick down": replace(PLAIN, widths=(1.0,), peaks=(-1.0,)),
    "two peaks, one much lower": replace(PLAIN, peaks=(1.0, 0.6)),
    "two peaks, one a little lower": replace(PLAIN, peaks=(1.0, 1.0), lower=(0.75, 0.92)),
    "two peaks of equal height, one longer": replace(PLAIN, peaks=(1.0, 1.0), widths=(0.6, 0.4), across=(0.1, 0.3)),
    "two peaks that differ across": replace(PLAIN, peaks=(1.0, 1.0), lower=(0.95, 1.0), across=(0.2, 0.4)),
    "two peaks, speeding up": replace(PLAIN, peaks=(1.0, 0.7), speeding=0.35),
    "two peaks, uneven tempo": replace(PLAIN, peaks=(1.0, 0.7), tempo=0.1),
    "three peaks": replace(PLAIN, peaks=(1.0, 0.6, 0.8)),
    "three peaks, nearly alike": replace(PLAIN, peaks=(1.0, 0.8, 0.9), across=(0.1, 0.3)),
    "tempo ±10 %": replace(PLAIN, tempo=0.1),
    "tempo ±20 %": replace(PLAIN, tempo=0.2),
    "speeding up": replace(PLAIN, speeding=0.4),
    "size ±15 %": replace(PLAIN, size=0.15),
    "swing shrinks": replace(PLAIN, growth=(-0.06, -0.02)),
    "swing grows": replace(PLAIN, growth=(0.02, 0.06)),
    "pauses": replace(PLAIN, pauses=0.25),
    "pauses with a regrasp": replace(PLAIN, pauses=0.2, regrasp_deg=5.0, cycles=(8, 20)),
    "grasp and release": replace(PLAIN, grasp_deg=6.0, cycles=(7, 20), drift_deg=(0.0, 1.0)),
    "tremor of 8 Hz": replace(PLAIN, tremor_deg=0.5, period_s=(2.0, 8.0)),
    "wandering axis": replace(PLAIN, wander_deg=40.0),
    "swing of 1.5 to 4°": replace(PLAIN, swing_deg=(1.5, 4.0), drift_deg=(0.0, 0.3), scatter_deg=(0.0, 0.05)),
    "swing of 150 to 340°": replace(PLAIN, swing_deg=(150.0, 340.0)),
    "20 Hz": replace(PLAIN, rate_hz=(20.0,), period_s=(2.0, 8.0)),
    "1 to 2 kHz": replace(PLAIN, rate_hz=(1000.0, 2000.0), period_s=(1.0, 3.0), cycles=(5, 10)),
    "much drift": replace(PLAIN, drift_deg=(2.0, 5.0), scatter_deg=(0.3, 1.0)),
    "pose noise": replace(PLAIN, pose_noise_deg=0.5),
    "two equal peaks (ambiguous)": replace(PLAIN, peaks=(1.0, 1.0), across=(0.0, 0.0), size=0.0, judged=False),
}


@dataclass(frozen=True, eq=False)
class Trial:
    """One trial and what is true of it."""

    series: OrientationSeries = field(repr=False)
    period_s: float
    """Median length of a cycle, without pauses."""
    n_cycles: int
    drift_deg: float
    """Mean rotation a cycle that was built in: what θ̄ estimates."""


def _uniform(rng: np.random.Generator, ends: tuple[float, float]) -> float:
    return float(rng.uniform(*ends))


def _unit(rng: np.random.Generator) -> FloatArray:
    axis = rng.normal(size=3)
    return np.asarray(axis / np.linalg.norm(axis))


def _cycle_shape(rng: np.random.Generator, regime: Regime) -> FloatArray:
    """(GRID + 1,) angle over one cycle, from 0 to 0, of size 1."""
    heights = [abs(regime.peaks[0]), *(height * _uniform(rng, regime.lower) for height in regime.peaks[1:])]
    widths = np.array(regime.widths or np.full(len(heights), 1.0))
    edges = np.concatenate(([0.0], np.cumsum(widths / widths.sum())))
    dip = 0.0 if len(heights) == 1 else _uniform(rng, (0.0, 0.2))
    rest, up = _uniform(rng, regime.rest) / 2.0, 0.8 if regime.peaks[0] < 0 else 0.5
    phases, values = [0.0], [0.0]
    for k, height in enumerate(heights):
        start, length = edges[k], edges[k + 1] - edges[k]
        low = 0.0 if k == len(heights) - 1 else dip
        phases += [start + length * part for part in (rest / 2, up - rest / 2, up + rest / 2, 1.0 - rest / 2)]
        values += [values[-1], height, height, low]
    phases.append(1.0)
    values.append(0.0)
    shape = np.interp(np.arange(GRID) / GRID, phases, values)
    shape = gaussian_filter1d(shape, 0.02 * GRID, mode="wrap")
    shape -= shape[0]
    return np.append(shape, shape[0])


def draw(name: str, seed: int) -> Trial:
    """Draw a trial of a regime; a pure function of both."""
    regime = REGIMES[name]
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    n, rate_hz = int(rng.integers(regime.cycles[0], regime.cycles[1] + 1)), float(rng.choice(regime.rate_hz))
    usual_s, swing = _uniform(rng, regime.period_s), np.radians(_uniform(rng, regime.swing_deg))
    lengths_s = usual_s * (1.0 - regime.speeding * np.arange(n) / n) * (1.0 + regime.tempo * rng.uniform(-1.0, 1.0, n))
    if regime.grasp_deg:
        lengths_s[[0, -1]] *= rng.choice([rng.uniform(0.6, 0.8), rng.uniform(1.25, 1.5)], 2)
    sizes = (1.0 + _uniform(rng, regime.growth)) ** np.arange(n) * (1.0 + regime.size * rng.uniform(-1.0, 1.0, n))
    paused = rng.random(n) < regime.pauses
    paused[-1] = False
    pauses_s = paused * rng.uniform(0.8, 2.5, n) * usual_s
    lead_s, tail_s = rng.uniform(1.0, 4.0, 2)
    starts_s = lead_s + np.concatenate(([0.0], np.cumsum(lengths_s + pauses_s)))
    times_s = np.arange(int((starts_s[-1] + tail_s) * rate_hz)) / rate_hz
    k = np.clip(np.searchsorted(starts_s, times_s, side="right") - 1, 0, n - 1)
    phase = np.clip((times_s - starts_s[k]) / lengths_s[k], 0.0, 1.0)
    grid = np.arange(GRID + 1) / GRID
    angle = swing * sizes[k] * np.interp(phase, grid, _cycle_shape(rng, regime))
    side = rng.normal(size=4)
    second = sum(part * np.sin((order + 1) * np.pi * phase) ** 2 for order, part in enumerate(side))
    across = swing * _uniform(rng, regime.across) * sizes[k] * second / max(float(np.abs(side).max()), 1e-9)

    drift_deg = _uniform(rng, regime.drift_deg)
    steps = np.radians(drift_deg) * _unit(rng) + np.radians(_uniform(rng, regime.scatter_deg)) * rng.normal(size=(n, 3))
    placed = np.radians(regime.pose_noise_deg) * rng.normal(size=(n + 1, 3))
    jumps = np.radians(regime.regrasp_deg) * paused[:, None] * rng.normal(size=(n, 3))
    if regime.grasp_deg:
        jumps[[0, -1]] += np.radians(regime.grasp_deg) * np.stack([_unit(rng), _unit(rng)])
    poses = Rotation.identity()
    ends = [Rotation.from_rotvec(placed[0])]
    for cycle in range(n):
        poses = Rotation.from_rotvec(steps[cycle] + jumps[cycle]) * poses
        ends.append(Rotation.from_rotvec(placed[cycle + 1]) * poses)
    # The step of a cycle happens on its way back, a jump in the pause behind it.
    turned = np.stack([(ends[cycle + 1] * ends[cycle].inv()).as_rotvec() for cycle in range(n)])
    share = np.clip((times_s - starts_s[k] - 0.75 * lengths_s[k]) / (0.2 * lengths_s[k] + pauses_s[k]), 0.0, 1.0)
    base = Rotation.from_rotvec(share[:, None] * turned[k]) * Rotation.concatenate(ends)[k]

    axis, other = _unit(rng), _unit(rng)
    other = np.cross(axis, other) / np.linalg.norm(np.cross(axis, other))
    lean = np.radians(regime.wander_deg) * (times_s - lead_s).clip(0.0) / (starts_s[-1] - lead_s)
    leaned = Rotation.from_rotvec(lean[:, None] * np.cross(axis, other))
    tremor = np.radians(regime.tremor_deg) * np.sin(2.0 * np.pi * 8.0 * times_s + rng.uniform(0.0, 6.3))
    motion = Rotation.from_rotvec(leaned.apply((angle + tremor)[:, None] * axis + across[:, None] * other))
    noise = np.radians(_uniform(rng, regime.noise_deg)) * rng.normal(size=(len(times_s), 3))
    mounted = Rotation.from_rotvec(rng.normal(size=3))
    quats = (Rotation.from_rotvec(noise) * base * motion * mounted).as_quat(scalar_first=True)
    return Trial(OrientationSeries(times_s, quats, np.arange(len(times_s))), float(np.median(lengths_s)), n, drift_deg)


def _walk(rng: np.random.Generator) -> Rotation:
    return Rotation.from_rotvec(np.cumsum(np.radians(0.8) * rng.normal(size=(6000, 3)), axis=0))


def _smooth(rng: np.random.Generator, axes: int, sigma_s: float) -> Rotation:
    vectors = gaussian_filter1d(rng.normal(size=(6000, axes)), 100.0 * sigma_s, axis=0)
    return Rotation.from_rotvec(np.radians(25.0) * vectors / vectors.std() @ np.eye(3)[:axes])


def _handling(rng: np.random.Generator) -> Rotation:
    """An object that is picked up, turned this way and that, and put down: strokes between poses that never return."""
    poses = Rotation.from_rotvec(np.radians(40.0) * rng.normal(size=(rng.integers(8, 25), 3)))
    at = np.sort(rng.uniform(0.0, 60.0, len(poses)))
    place = np.clip(np.searchsorted(at, np.arange(6000) / 100.0), 1, len(poses) - 1)
    part = np.clip((np.arange(6000) / 100.0 - at[place - 1]) / (at[place] - at[place - 1]), 0.0, 1.0)
    part = part * part * (3.0 - 2.0 * part)
    return Rotation.from_rotvec(part[:, None] * (poses[place] * poses[place - 1].inv()).as_rotvec()) * poses[place - 1]


def _one_way(rng: np.random.Generator) -> Rotation:
    speed = np.radians(30.0) * (1.0 + 0.3 * gaussian_filter1d(rng.normal(size=6000), 60.0) * 10.0)
    return Rotation.from_rotvec(np.cumsum(speed)[:, None] / 100.0 * _unit(rng))


RANDOM: dict[str, Callable[[np.random.Generator], Rotation]] = {
    "random walk": _walk,
    "smooth, one axis, 0.5 s": lambda rng: _smooth(rng, 1, 0.5),
    "smooth, one axis, 1.5 s": lambda rng: _smooth(rng, 1, 1.5),
    "smooth, all axes, 0.5 s": lambda rng: _smooth(rng, 3, 0.5),
    "smooth, all axes, 1.5 s": lambda rng: _smooth(rng, 3, 1.5),
    "handling": _handling,
    "turning one way": _one_way,
}


def random_motion(name: str, seed: int) -> OrientationSeries:
    """Draw a minute of motion at 100 Hz that repeats nothing."""
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    quats = RANDOM[name](rng).as_quat(scalar_first=True)
    return OrientationSeries(np.arange(len(quats)) / 100.0, quats, np.arange(len(quats)))


@dataclass(frozen=True)
class Row:
    """What became of the trials of one regime."""

    name: str
    trials: int
    wrong: int
    """Accepted with another period."""
    refused: int
    lost_cycles: float
    """Mean share of the cycles that have no step in the score, of the right ones."""
    covered: float
    """Share of intervals that hold the drift, of the right ones that have one."""
    half_width_deg: float
    """Median."""
    judged: bool = True


def measure(name: str, seeds: range) -> Row:
    """Score the trials of a regime with these seeds."""
    wrong, refused, lost, covered, half_widths = 0, 0, [], [], []
    for seed in seeds:
        trial = draw(name, seed)
        score = analysis.score(trial.series)
        if not score.valid or score.period_s is None:
            refused += 1
        elif abs(score.period_s / trial.period_s - 1.0) > WRONG_BY:
            wrong += 1
        else:
            lost.append(1.0 - (len(score.endpoints) - 1) / (trial.n_cycles - 1))
            if score.interval_deg is not None:
                low, high = score.interval_deg
                covered.append(low <= trial.drift_deg <= high)
                half_widths.append((high - low) / 2.0)
    return Row(
        name,
        len(seeds),
        wrong,
        refused,
        float(np.mean(lost)) if lost else float("nan"),
        float(np.mean(covered)) if covered else float("nan"),
        float(np.median(half_widths)) if half_widths else float("nan"),
        REGIMES[name].judged,
    )


def rows(seeds: range, only: list[str]) -> Iterator[Row]:
    for name in REGIMES:
        if not only or name in only:
            yield measure(name, seeds)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.regimes")
    parser.add_argument("trials", nargs="?", type=int, default=80)
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="seed of the first trial of each regime")
    parser.add_argument("--only", nargs="*", default=[], metavar="REGIME")
    args = parser.parse_args(arguments)
    seeds = range(args.first, args.first + args.trials)
    judged = []
    print(f"{'regime':40}{'wrong':>8}{'refused':>9}{'cycles lost':>13}{'covered':>9}{'half-width':>12}")
    for row in rows(seeds, args.only):
        print(
            f"{row.name:40}{row.wrong / row.trials:8.1%}{row.refused / row.trials:9.1%}{row.lost_cycles:13.1%}"
            f"{row.covered:9.2f}{row.half_width_deg:11.3f}°{'' if row.judged else '   (not judged)'}",
            flush=True,
        )
        if row.judged:
            judged.append(row)
    n = sum(row.trials for row in judged)
    if n:
        wrong, refused = (sum(getattr(row, what) for row in judged) / n for what in ("wrong", "refused"))
        print(f"\n{n} periodic trials: period wrong {wrong:.1%} (goal 1 %), refused {refused:.1%} (goal 3 %)")
    if not args.only:
        taken = {name: sum(analysis.score(random_motion(name, k)).valid for k in seeds) for name in RANDOM}
        print("\n" + "\n".join(f"{name:40}{n / args.trials:8.1%} taken for a trial" for name, n in taken.items()))
        print(f"{sum(taken.values()) / (len(taken) * args.trials):.2%} of random motions (goal 0.2 %)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
