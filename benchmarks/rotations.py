"""Batch rotations against scipy's, and the single-sample operations of the live path.

The goal is set for what a user does with either library: an array of quaternions goes in, an array comes out. What
scipy takes where its Rotation objects are there already is shown beside it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.cycles.online.angle import OnlineAngle, _rotation_vector
from analysis.geometry import rotations
from benchmarks.measurement import COST, Topic, figure, ratio, rounds_of

GOAL = 0.2


def measure(quick: bool = False) -> Topic:
    """Measure everything of this topic."""
    topic = Topic("Rotations: numpy in blocks against scipy Rotation")
    n = 200_000 if quick else 1_000_000
    rng = np.random.default_rng(1)
    p, q = (rng.normal(size=(n, 4)) for _ in range(2))
    p /= np.linalg.norm(p, axis=1)[:, None]
    q /= np.linalg.norm(q, axis=1)[:, None]
    left, right = (Rotation.from_quat(rotations.to_xyzw(x)) for x in (p, q))

    pairs: dict[str, tuple[Callable[[], object], Callable[[], object], float]] = {
        "multiply": (
            lambda: rotations.multiply(p, q),
            lambda: left * right,
            _apart(rotations.multiply(p, q), rotations.from_xyzw((left * right).as_quat())),
        ),
        "inverse": (
            lambda: rotations.conjugate(q),
            right.inv,
            _apart(rotations.conjugate(q), rotations.from_xyzw(right.inv().as_quat())),
        ),
        "rotvec": (
            lambda: rotations.log(q),
            right.as_rotvec,
            float(np.abs(rotations.log(q) - right.as_rotvec()).max()),
        ),
        "angle": (
            lambda: rotations.angle(q),
            right.magnitude,
            float(np.abs(rotations.angle(q) - right.magnitude()).max()),
        ),
    }
    x, y = rotations.to_xyzw(p), rotations.to_xyzw(q)  # scipy's own order, so that it need not turn it round
    arrays: dict[str, Callable[[], object]] = {
        "multiply": lambda: (Rotation.from_quat(x) * Rotation.from_quat(y)).as_quat(),
        "inverse": lambda: Rotation.from_quat(y).inv().as_quat(),
        "rotvec": lambda: Rotation.from_quat(y).as_rotvec(),
        "angle": lambda: Rotation.from_quat(y).magnitude(),
    }
    functions: dict[str, Callable[[], object]] = {"copy": q.copy}
    for name, (ours, scipy, _) in pairs.items():
        functions |= {f"ours {name}": ours, f"scipy {name}": scipy, f"arrays {name}": arrays[name]}
    times = rounds_of(functions, 3 if quick else 9)
    for name, (_, _, apart) in pairs.items():
        assert apart < 1e-12, (name, apart)
        note = f"{1e9 * min(times[f'ours {name}']) / n:.1f} ns a row; largest difference {apart:.0e}"
        title = f"{name}, array to array: time of ours / scipy"
        topic.rows.append(ratio(title, times[f"ours {name}"], times[f"arrays {name}"], GOAL, COST, note=note))
    for name in pairs:
        note = "no goal: scipy is given Rotation objects and may leave its result in one"
        title = f"{name}, Rotation objects there: time of ours / scipy"
        topic.rows.append(ratio(title, times[f"ours {name}"], times[f"scipy {name}"], note=note))
    topic.rows.append(ratio("inverse: time of ours / np.copy of the array", times["ours inverse"], times["copy"]))
    _single(topic, p.tolist(), quick)
    return topic


def _apart(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Largest difference of quaternions, whichever sign they have."""
    return float(np.minimum(np.abs(ours - theirs).max(axis=1), np.abs(ours + theirs).max(axis=1)).max())


def _single(topic: Topic, rows: list[list[float]], quick: bool) -> None:
    """Plain Python on one sample at a time."""
    quats = [(w, x, y, z) for w, x, y, z in rows[:5000]]
    pairs = list(zip(quats[1:], quats[:-1], strict=True))
    one = Rotation.from_quat(quats[0])

    def turn() -> None:
        for later, earlier in pairs:
            _rotation_vector(later, earlier)

    def follow() -> None:
        angle = OnlineAngle()
        for k, quat in enumerate(quats):
            angle.add(k * 0.01, quat, k, 2.0)

    def scipy_turn() -> None:
        for _ in range(200):
            (one * one.inv()).as_rotvec()

    times = rounds_of({"turn": turn, "follow": follow, "scipy": scipy_turn}, 5 if quick else 15)
    turns = [1e6 * t / len(pairs) for t in times["turn"]]
    topic.rows.append(figure("one rotation vector of a difference", turns, "µs", "plain Python", 1.0, COST))
    follows = [1e6 * t / len(quats) for t in times["follow"]]
    topic.rows.append(figure("one moment of the online angle (100 a second)", follows, "µs", "plain Python"))
    topic.rows.append(figure("the same rotation vector by scipy", [1e6 * t / 200 for t in times["scipy"]], "µs"))
