"""Does the data contradict the declared convention? θ̄ alone does not show it.

Components read in the wrong order, or orientations read the wrong way round, give a plausible θ̄ and a drift axis that
is wrong by 43 to 89 degrees. What can show it: jumps, the direction of gravity, and the axis of motion. A silent check
proves nothing; each warning names what was seen.
"""

from __future__ import annotations

import numpy as np

from analysis.geometry import averages, rotations
from analysis.series import GAP_FACTOR, FloatArray, OrientationSeries

JUMP_DEG = 25.0
"""A step between neighbouring samples is a jump from here on, if it also stands out tenfold."""
MAX_WANDER_DEG = 11.5
"""Root mean square angle by which "up" may wander in the world frame: a hand accelerates what it moves."""
MIN_WANDER_DEG = 3.0
"""From here on a wandering counts if another reading of the same numbers would halve it."""
MIN_TURN_FOR_GRAVITY_DEG = 5.0
GRAVITY_RANGE_MPS2 = (5.0, 15.0)
"""The usual acceleration of something held in a hand; outside it the numbers are in another unit or hold no gravity."""
AXIS_MARGIN = 0.01
"""How much steadier the motion axis may be in the body than in the world before that is suspicious."""
_SPEED_INTERVAL_S = 0.05
_MAX_POINTS = 200_000  # thinned beyond this: the checks are statistics


def convention_warnings(series: OrientationSeries) -> tuple[str, ...]:
    """Return one sentence for each contradiction between the data and the convention they were read with."""
    if len(series) < 10:
        return ()
    return (*_jumps(series), *_gravity(series), *_axis_of_motion(series))


def _jumps(series: OrientationSeries) -> tuple[str, ...]:
    steps_deg = np.degrees(rotations.distance(series.quats_wxyz[1:], series.quats_wxyz[:-1]))
    usual = float(np.percentile(steps_deg, 99.0))
    gap_free = np.diff(series.times_s) <= GAP_FACTOR * series.interval_s
    jumps = np.flatnonzero((steps_deg > max(JUMP_DEG, 10.0 * usual)) & gap_free)
    if not len(jumps):
        return ()
    first = int(jumps[0]) + 1
    return (
        f"orientation jumps {len(jumps)} time{'s' * (len(jumps) > 1)}, first by {steps_deg[first - 1]:.0f}° at "
        f"{series.index_kind} {series.index[first]}: wrong Euler order, wrong columns, or a sensor that lost track?",
    )


def _gravity(series: OrientationSeries) -> tuple[str, ...]:
    """Specific force points up in the world whatever the object does, if the orientations are right."""
    if series.accelerations_mps2 is None:
        return ()
    thin = slice(None, None, max(1, len(series) // _MAX_POINTS))
    quats, forces = series.quats_wxyz[thin], series.accelerations_mps2[thin]
    sound = np.isfinite(forces).all(axis=1) & (np.linalg.norm(forces, axis=1) > 0.0)
    quats, forces = quats[sound], forces[sound]
    if len(quats) < 10:
        return ()
    usual = float(np.median(np.linalg.norm(forces, axis=1)))
    if not GRAVITY_RANGE_MPS2[0] <= usual <= GRAVITY_RANGE_MPS2[1]:
        return (
            f"the usual acceleration is {usual:.3g} m/s², gravity alone is 9.81: another unit, or gravity taken off? "
            "The orientations could not be compared with it",
        )
    if np.degrees(rotations.distance(quats, averages.average(quats)).max()) < MIN_TURN_FOR_GRAVITY_DEG:
        return ()  # too little turning to tell one reading from another
    # Whatever was mistaken, one of these other readings of the same numbers would be the true one, and in it gravity
    # would stand still.
    readings = {
        "the other way round (world to body)": rotations.conjugate(quats),
        "with the scalar last": rotations.from_xyzw(quats),
        "with the scalar first": rotations.to_xyzw(quats),
        "with the scalar last and the other way round": rotations.conjugate(rotations.from_xyzw(quats)),
        "with the scalar first and the other way round": rotations.conjugate(rotations.to_xyzw(quats)),
    }
    as_read = _wander_deg(quats, forces)
    best, least = min(((name, _wander_deg(q, forces)) for name, q in readings.items()), key=lambda pair: pair[1])
    better = as_read > MIN_WANDER_DEG and least < 0.5 * as_read
    if as_read <= MAX_WANDER_DEG and not better:
        return ()
    hint = f"; read {best} it would be {least:.1f}°" if better else ""
    return (
        f"gravity wanders by {as_read:.1f}° (root mean square) in the world frame{hint}: check the order of the "
        "components and the direction of the rotation",
    )


def _wander_deg(quats: FloatArray, forces: FloatArray) -> float:
    """Return the root mean square angle of the forces from their mean in the world frame, deg; for small angles.

    The mean of unit vectors at small angles α to it is shorter than they are by half the mean of α².
    """
    in_world = rotations.rotate(quats, forces)
    steadiness = float(np.linalg.norm(in_world.mean(axis=0)) / np.linalg.norm(in_world, axis=1).mean())
    return float(np.degrees(np.sqrt(2.0 * max(1.0 - steadiness, 0.0))))


def _axis_of_motion(series: OrientationSeries) -> tuple[str, ...]:
    """Compare how steady the axis is: the hand turns the object about its own axes; creep makes these wander in it."""
    every = max(1, round(_SPEED_INTERVAL_S / series.interval_s), len(series) // _MAX_POINTS)
    quats = series.quats_wxyz[::every]
    if len(quats) < 10:
        return ()
    world = _axis_share(rotations.difference(quats[1:], quats[:-1]))
    body = _axis_share(rotations.multiply(rotations.conjugate(quats[:-1]), quats[1:]))
    if body <= world + AXIS_MARGIN or body < 0.6:
        return ()
    return (
        f"the axis of motion is steadier in the object ({body:.3f}) than in the world ({world:.3f}): are these "
        "orientations world to body, the components in another order, or does the sensor's heading drift?",
    )


def _axis_share(steps: FloatArray) -> float:
    vectors = rotations.log(steps)
    values = np.linalg.eigvalsh(vectors.T @ vectors)
    total = float(values.sum())
    return float(values[-1]) / total if total > 0.0 else 0.0
