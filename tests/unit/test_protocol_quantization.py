"""Unit quaternions to wire forms and back: stated bounds, worst cases, refusals. scipy is the judge of angles."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firmware_protocol import quantization as quant
from firmware_protocol.errors import MalformedPacketError, PacketValueError


def angles_rad(p_wxyz, q_wxyz):
    """Rotation angles between rows, from the chord of the four-vectors: exact where acos would lose everything."""
    p, q = np.atleast_2d(p_wxyz), np.atleast_2d(q_wxyz)
    chord = np.minimum(np.linalg.norm(p - q, axis=1), np.linalg.norm(p + q, axis=1))
    return 4.0 * np.arcsin(chord / 2.0)


def smallest_three(q_wxyz):
    return int(quant.quats_to_smallest_three([q_wxyz])[0])


def random_units(n, seed):
    q = np.random.default_rng(seed).normal(size=(n, 4))
    return q / np.linalg.norm(q, axis=1)[:, None]


def near(centre, n, spread, seed):
    """Quaternions around one place, where rounding errors of all components meet in every combination."""
    q = np.asarray(centre) + np.random.default_rng(seed).uniform(-spread, spread, size=(n, 4))
    return q / np.linalg.norm(q, axis=1)[:, None]


HARD = {
    "uniform": random_units(100_000, 1),
    "all equal": near([0.5, 0.5, 0.5, 0.5], 100_000, 1e-3, 2),
    "mixed signs": near([-0.5, 0.5, -0.5, 0.5], 100_000, 1e-3, 3),
    "three equal": near([0.0, 1 / math.sqrt(3)] + [1 / math.sqrt(3)] * 2, 100_000, 1e-3, 4),
    "two equal": near([math.sqrt(0.5), 0.0, 0.0, -math.sqrt(0.5)], 100_000, 1e-3, 5),
    "identity": near([1.0, 0.0, 0.0, 0.0], 100_000, 1e-4, 6),
}


def test_the_measure_of_angles_agrees_with_scipy():
    p, q = random_units(100, 7), random_units(100, 8)
    expected = (Rotation.from_quat(p[:, [1, 2, 3, 0]]).inv() * Rotation.from_quat(q[:, [1, 2, 3, 0]])).magnitude()
    assert np.allclose(angles_rad(p, q), expected, atol=1e-12)


def test_the_stated_bounds():
    assert quant.Q15_MAX_ERROR_DEG <= 0.0035
    assert quant.SMALLEST_THREE_MAX_ERROR_DEG <= 0.0009
    assert quant.SMALLEST_THREE_PLAIN_MAX_ERROR_DEG <= 0.0011


@pytest.mark.parametrize("name", HARD)
def test_q15_stays_within_its_bound(name):
    quats = HARD[name]
    decoded, valid = quant.quats_from_q15(quant.quats_to_q15(quats))
    assert valid.all()
    assert np.abs(np.linalg.norm(decoded, axis=1) - 1.0).max() < 5e-16
    assert angles_rad(quats, decoded).max() <= quant.Q15_MAX_ERROR_RAD


def test_the_q15_bound_is_nearly_reached():
    """All four components half a step off, at right angles to the quaternion: the bound is tight."""
    codes = np.array([16384.0, 16383.0, 16384.0, 16383.0])
    target = (codes + np.array([0.499, -0.499, -0.499, 0.499])) / quant.Q15_SCALE
    target /= np.linalg.norm(target)
    decoded = quant.quats_from_q15(quant.quats_to_q15(target[None]))[0]
    assert angles_rad(target, decoded)[0] > 0.9 * quant.Q15_MAX_ERROR_RAD


@pytest.mark.parametrize("name", HARD)
def test_smallest_three_stays_within_its_bound(name):
    quats = HARD[name]
    decoded, valid = quant.quats_from_smallest_three(quant.quats_to_smallest_three(quats))
    assert valid.all()
    assert np.abs(np.linalg.norm(decoded, axis=1) - 1.0).max() < 5e-16
    assert angles_rad(quats, decoded).max() <= quant.SMALLEST_THREE_MAX_ERROR_RAD


def plain_codes(quats):
    """What simple firmware does: round each component by itself. Only for rows whose first component is largest."""
    codes = np.rint(quats[:, 1:] * np.sign(quats[:, :1]) * quant.SMALLEST_THREE_SCALE).astype(np.int64) + 2**17
    return (codes[:, 0] << 36 | codes[:, 1] << 18 | codes[:, 2]).astype(np.uint64)


def test_smallest_three_by_plain_rounding_has_the_larger_bound():
    quats = near([0.5, 0.5, 0.5, 0.5], 400_000, 1e-3, 9)
    quats = quats[np.abs(quats[:, 0]) >= np.abs(quats[:, 1:]).max(axis=1)]
    decoded, valid = quant.quats_from_smallest_three(plain_codes(quats))
    assert valid.all()
    worst = angles_rad(quats, decoded).max()
    assert quant.SMALLEST_THREE_MAX_ERROR_RAD < worst <= quant.SMALLEST_THREE_PLAIN_MAX_ERROR_RAD
    best = quant.quats_from_smallest_three(quant.quats_to_smallest_three(quats))[0]
    assert angles_rad(quats, best).max() < 0.65 * worst


def test_the_smallest_three_code_is_as_laid_down():
    assert smallest_three((1.0, 0.0, 0.0, 0.0)) == 0 << 54 | 0x20000 << 36 | 0x20000 << 18 | 0x20000
    assert smallest_three((0.0, 0.0, 0.0, -1.0)) == 3 << 54 | 0x20000 << 36 | 0x20000 << 18 | 0x20000
    step = 1.0 / quant.SMALLEST_THREE_SCALE
    w = math.sqrt(1.0 - 5.0 * step**2)
    assert smallest_three((w, step, 0.0, -2 * step)) == 0x20001 << 36 | 0x20000 << 18 | 0x1FFFE
    half = math.sqrt(0.5)
    assert smallest_three((half, half - 1e-12, 0.0, 0.0)) >> 36 == 0x3FFFF


def test_scalar_and_batch_agree_to_the_last_bit():
    quats = np.concatenate([rows[:100] for rows in HARD.values()])
    codes = quant.quats_to_q15(quats)
    decoded = quant.quats_from_q15(codes)[0]
    packed = quant.quats_to_smallest_three(quats)
    unpacked = quant.quats_from_smallest_three(packed)[0]
    for k, quat in enumerate(quats.tolist()):
        assert quant.quat_to_q15(quat) == tuple(codes[k].tolist())
        assert quant.quat_from_q15(*codes[k].tolist()) == tuple(decoded[k].tolist())
        assert smallest_three(quat) == int(packed[k])
        assert np.array_equal(quant.quats_from_smallest_three(packed[k : k + 1])[0][0], unpacked[k])


def test_every_axis_quaternion_is_exact():
    for quat in np.concatenate([np.eye(4), -np.eye(4)]):
        assert quant.quat_from_q15(*quant.quat_to_q15(quat)) == tuple(quat)
        assert np.array_equal(
            quant.quats_from_smallest_three(quant.quats_to_smallest_three([quat]))[0][0], np.abs(quat)
        )


@pytest.mark.parametrize(
    "quat", [(0.0,) * 4, (1.011, 0.0, 0.0, 0.0), (0.989, 0.0, 0.0, 0.0), (math.nan,) * 4, (math.inf,) * 4]
)
def test_what_is_not_unit_is_refused(quat):
    for scalar in (quant.quat_to_q15, smallest_three):
        with pytest.raises(PacketValueError, match="norm"):
            scalar(quat)
    for batch in (quant.quats_to_q15, quant.quats_to_smallest_three):
        with pytest.raises(PacketValueError, match="quaternion 1: norm"):
            batch([(1.0, 0.0, 0.0, 0.0), quat])


@pytest.mark.parametrize("batch", [quant.quats_to_q15, quant.quats_to_smallest_three])
def test_shapes_are_checked(batch):
    with pytest.raises(PacketValueError, match="shape"):
        batch(np.zeros((3, 3)))
    assert len(batch(np.zeros((0, 4)))) == 0


@pytest.mark.parametrize(
    ("codes", "valid"),
    [
        ((32767, 0, 0, 0), True),
        ((-32768, 0, 0, 0), True),
        ((0, 0, 33094 - 327, 0), True),
        ((32767, 4645, 0, 0), True),  # norm 1.00999
        ((32767, 4650, 0, 0), False),  # norm 1.01002
        ((32440, 0, 0, 0), True),  # norm 0.99002
        ((32439, 0, 0, 0), False),
        ((0, 0, 0, 0), False),
        ((-32768, -32768, -32768, -32768), False),
    ],
)
def test_wire_norms_are_judged_alike_by_scalar_and_batch(codes, valid):
    assert quant.quats_from_q15(np.array([codes], dtype=np.int16))[1].tolist() == [valid]
    if valid:
        quant.quat_from_q15(*codes)
    else:
        with pytest.raises(MalformedPacketError):
            quant.quat_from_q15(*codes)


@pytest.mark.parametrize("code", [0, 0x3FFFF << 36 | 0x3FFFF << 18 | 0x3FFFF, 0x20000 << 36 | 0x20000 << 18])
def test_impossible_smallest_three_codes_are_not_valid(code):
    assert quant.quats_from_smallest_three(np.array([code], np.uint64))[1].tolist() == [False]
