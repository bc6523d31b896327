"""Laws of quaternion arithmetic for any input."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from analysis.geometry import averages, rotations
from analysis.geometry.euler_angles import from_euler, to_euler_zyx

components = st.floats(-1.0, 1.0, allow_subnormal=False)


@st.composite
def unit_quaternions(draw, n=None):
    count = n if n is not None else draw(st.integers(1, 9))
    raw = draw(arrays(np.float64, (count, 4), elements=components))
    norms = np.linalg.norm(raw, axis=1, keepdims=True)
    raw = np.where(norms < 0.1, [1.0, 0.0, 0.0, 0.0], raw)
    return raw / np.linalg.norm(raw, axis=1, keepdims=True)


def assert_same(p, q, tolerance=1e-12):
    assert rotations.distance(p, q).max(initial=0.0) < 4 * tolerance


@given(unit_quaternions(), unit_quaternions(1), unit_quaternions(1))
def test_multiplication_is_associative_and_keeps_the_norm(p, q, r):
    left = rotations.multiply(rotations.multiply(p, q[0]), r[0])
    right = rotations.multiply(p, rotations.multiply(q[0], r[0]))
    np.testing.assert_allclose(left, right, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(left, axis=1), 1.0, atol=1e-14)


@given(unit_quaternions())
def test_conjugate_undoes(p):
    np.testing.assert_allclose(
        rotations.multiply(p, rotations.conjugate(p)), np.tile([1.0, 0.0, 0.0, 0.0], (len(p), 1)), atol=1e-15
    )


@given(unit_quaternions())
def test_exp_undoes_log_and_signs_do_not_matter(p):
    assert_same(rotations.exp(rotations.log(p)), p, 1e-11)
    np.testing.assert_array_equal(rotations.angle(p), rotations.angle(-p))
    lengths = np.linalg.norm(rotations.log(p), axis=1)
    np.testing.assert_allclose(lengths, rotations.angle(p), atol=1e-13)
    assert (rotations.angle(p) <= np.pi).all()


@given(unit_quaternions(1), unit_quaternions(1), unit_quaternions(1))
def test_distance_is_a_metric_that_neither_frame_changes(p, q, r):
    d = rotations.distance
    assert d(p, r)[0] <= d(p, q)[0] + d(q, r)[0] + 1e-7
    np.testing.assert_allclose(d(rotations.multiply(r, p), rotations.multiply(r, q)), d(p, q), atol=1e-7)
    np.testing.assert_allclose(d(rotations.multiply(p, r), rotations.multiply(q, r)), d(p, q), atol=1e-7)


@given(unit_quaternions(), st.integers(0, 2**16 - 1))
def test_average_ignores_signs_and_order_and_turns_with_the_data(p, seed):
    rng = np.random.default_rng(seed)
    near = rotations.multiply(rotations.exp(rng.normal(scale=0.2, size=(len(p), 3))), p[0])
    mean, share = averages.average_and_share(near)
    assert 0.25 <= share <= 1.0 + 1e-12
    flipped = near * rng.choice([-1.0, 1.0], size=(len(p), 1))
    assert_same(averages.average(flipped[rng.permutation(len(p))]), mean, 1e-9)
    turned = rotations.multiply(p[-1], rotations.multiply(near, p[0]))
    assert_same(averages.average(turned), rotations.multiply(p[-1], rotations.multiply(mean, p[0])), 1e-9)


@given(unit_quaternions(), st.integers(0, 2**16 - 1))
def test_continuous_signs_are_idempotent_and_flip_blind(p, seed):
    flips = np.random.default_rng(seed).choice([-1.0, 1.0], size=(len(p), 1))
    once = rotations.continuous_signs(p * flips)
    np.testing.assert_array_equal(rotations.continuous_signs(once), once)
    assert (np.abs(once) == np.abs(p)).all()
    assert (np.einsum("ij,ij->i", once[1:], once[:-1]) >= 0.0).all()


@given(unit_quaternions())
def test_euler_round_trip(p):
    assert_same(from_euler(to_euler_zyx(p), "zyx", intrinsic=True), p, 1e-6)  # the poles halve the digits
