"""The lower envelope against linear programming and against the definition."""

import numpy as np
import pytest
from scipy.optimize import linprog

from host.clock.envelope import DelayLine, envelope_line, hull_line, line_with_slope, lower_hull


def random_points(seed: int, n: int) -> list[tuple[int, int]]:
    rng = np.random.default_rng(seed)
    x = np.sort(rng.choice(60_000_000, n, replace=False))
    y = rng.exponential(1e6, n) + 0.1 * x + 5e9
    return list(zip(x.tolist(), np.rint(y).astype(int).tolist(), strict=True))


@pytest.mark.parametrize("seed", range(8))
def test_envelope_is_the_optimum_of_the_linear_programme(seed: int):
    points = random_points(seed, 40)
    x = np.array([p[0] for p in points]) * 1e-6
    y = (np.array([p[1] for p in points]) - 5e9) * 1e-6
    # greatest sum of a + b x_i, that is the least sum of distances, with a + b x_i <= y_i
    best = linprog([-len(x), -x.sum()], A_ub=np.column_stack([np.ones_like(x), x]), b_ub=y, bounds=[(None, None)] * 2)
    line = envelope_line(points)
    mine = np.array([line.delay_at(px) for px, _ in points])
    assert (mine <= np.array([py for _, py in points]) + 1e-3).all()
    assert (mine - 5e9).sum() * 1e-6 == pytest.approx(-best.fun, rel=1e-9)


def test_hull_keeps_only_corners():
    assert lower_hull([(0, 5), (1, 1), (2, 2), (3, 0), (4, 0), (5, 0), (6, 9)]) == [
        (0, 5),
        (1, 1),
        (3, 0),
        (5, 0),
        (6, 9),
    ]


def test_of_two_points_at_one_time_the_lower_counts():
    assert lower_hull([(0, 3), (0, 2), (5, 7), (5, 8)]) == [(0, 2), (5, 7)]


def test_hull_line_is_the_edge_at_that_time_and_the_nearest_outside():
    points = [(0, 100), (10, 0), (20, 0), (30, 200)]
    assert hull_line(points, 4) == DelayLine(4, 60.0, -10.0)
    assert hull_line(points, 15) == DelayLine(15, 0.0, 0.0)
    assert hull_line(points, 40) == DelayLine(40, 400.0, 20.0)
    assert hull_line(points, -1) == DelayLine(-1, 110.0, -10.0)
    assert hull_line([(7, 3)], 9) == DelayLine(9, 3.0, 0.0)


def test_line_with_slope_touches_from_below():
    line = line_with_slope([(0, 10), (10, 25), (20, 60)], 2.0)
    assert [line.delay_at(x) for x in (0, 10, 20)] == [5.0, 25.0, 45.0]
    assert line.lowered(3.0).delay_at(10) == 22.0


def test_nothing_has_no_envelope():
    for call in (envelope_line, lambda p: hull_line(p, 0), lambda p: line_with_slope(p, 0.0)):
        with pytest.raises(ValueError, match="at least one"):
            call([])


def test_days_of_device_time_map_to_the_nanosecond():
    line = DelayLine(10**12, 987_654_321_987_654.0, 0.1)
    assert line.to_host_ns([10**12, 10**12 + 10, 10**12 + 10**7]).tolist() == [
        10**15 + 987_654_321_987_654,
        10**15 + 10_000 + 987_654_321_987_655,
        10**15 + 10**10 + 987_654_321_987_654 + 10**6,
    ]
