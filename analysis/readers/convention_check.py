"""Does the data contradict the declared convention? θ̄ alone cannot tell.

Components read in the wrong order, or orientations read the wrong way round, give a plausible θ̄ and a drift axis that
is wrong by 43 to 89 degrees. What can show it: jumps, the direction of gravity, and the axis of motion. A silent check
proves nothing; each warning names what was seen.
"""

from __future__ import annotations

import numpy as np

from analysis import averages, rotations
from analysis.series import FloatArray, OrientationSeries

JUMP_DEG = 25.0
"""A step between neighbouring samples is a jump from here on, if it also stands out tenfold."""
GRAVITY_SHARE = 0.98
"""|mean| over mean |.| of the world-frame acceleration: below this "up" wanders about."""
MIN_TURN_FOR_GRAVITY_DEG = 15.0
AXIS_MARGIN = 0.01
"""How much steadier the motion axis may be in the body than in the world before that is suspicious."""
_SPEED_INTERVAL_S = 0.05
_MAX_POINTS = 200_000  # thinned beyond this: the checks are statistics


def convention_warnings(series: OrientationSeries) -> tuple[str, ...]:
    """Look for contradictions between the data and the convention they were read with.

    Parameters
    ----------
    series
        The recording as read.

    Returns
    -------
    One sentence for each contradiction.
    """
    if len(series) < 10:
        return ()
    return (*_jumps(series), *_gravity(series), *_axis_of_motion(series))


def _jumps(series: OrientationSeries) -> tuple[str, ...]:
    steps_deg = np.degrees(rotations.distance(series.quats_wxyz[1:], series.quats_wxyz[:-1]))
    usual = float(np.percentile(steps_deg, 99.0))
    gap_free = np.diff(series.times_s) <= 5.0 * series.interval_s
    jumps = np.flatnonzero((steps_deg > max(JUMP_DEG, 10.0 * usual)) & gap_free)
    if not len(jumps):
        return ()
    first = int(jumps[0]) + 1
    return (
        f"orientation jumps {len(jumps)} times, first by {steps_deg[first - 1]:.0f} deg at {series.index_kind} "
        f"{series.index[first]}: wrong Euler order, wrong columns, or a sensor that lost track?",
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
    if np.degrees(rotations.distance(quats, averages.average(quats)).max()) < MIN_TURN_FOR_GRAVITY_DEG:
        return ()  # too little turning to tell one reading from another
    as_read = _steadiness(quats, forces)
    if as_read >= GRAVITY_SHARE:
        return ()
    readings = {
        "the other way round (world to body)": rotations.conjugate(quats),
        "with the scalar last": rotations.from_xyzw(quats),
        "with the scalar first": rotations.to_xyzw(quats),
        "with the scalar last and the other way round": rotations.conjugate(rotations.from_xyzw(quats)),
        "with the scalar first and the other way round": rotations.conjugate(rotations.to_xyzw(quats)),
    }
    best, steadiness = max(((name, _steadiness(q, forces)) for name, q in readings.items()), key=lambda pair: pair[1])
    hint = f"; read {best} it would be {steadiness:.3f}" if steadiness > max(GRAVITY_SHARE, as_read) else ""
    return (
        f"gravity wanders in the world frame (steadiness {as_read:.3f}, 1 is perfect){hint}: check the order of the "
        "components and the direction of the rotation",
    )


def _steadiness(quats: FloatArray, forces: FloatArray) -> float:
    in_world = rotations.rotate(quats, forces)
    return float(np.linalg.norm(in_world.mean(axis=0)) / np.linalg.norm(in_world, axis=1).mean())


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
        "orientations world to body, or the components in another order?",
    )


def _axis_share(steps: FloatArray) -> float:
    vectors = rotations.log(steps)
    values = np.linalg.eigvalsh(vectors.T @ vectors)
    total = float(values.sum())
    return float(values[-1]) / total if total > 0.0 else 0.0
