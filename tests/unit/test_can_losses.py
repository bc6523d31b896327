"""What CAN decoders make of losses, strangers, resets and two objects with one id."""

import dataclasses

import numpy as np
import pytest

from firmware_protocol.can.decoder import CanStreamDecoder
from firmware_protocol.can.frames import CanFrame, FrameFlag
from firmware_protocol.can.mapping import CanFunction, arbitration_id
from tests.can_traffic import fed, joined, object_at, sample_packets, sample_rows, timed
from tests.sequence_oracle import counted

LOSSES = [
    1,
    2,
    63,
    64,
    128,
    191,
    192,
    247,
    248,
    250,
    252,
    254,
    255,
    256,
    257,
    300,
    511,
    512,
    513,
    768,
    1000,
    2560,
    3000,
]
MS = 1_000_000


@pytest.fixture(scope="module")
def traffic() -> list[CanFrame]:
    return timed(object_at(), sample_packets(6000), MS)


def without(frames: list[CanFrame], first: int, count: int) -> list[CanFrame]:
    """Drop everything on the bus while samples first … first + count - 1 were sent."""
    rows = sample_rows(frames)
    return frames[: rows[first]] + frames[rows[first + count - 1] + 1 :]


@pytest.mark.parametrize("lost", LOSSES)
@pytest.mark.parametrize("first", [900, 959, 960])
@pytest.mark.parametrize("at_once", [19, 100_000])
def test_losses_in_a_row_are_counted_exactly_and_every_sample_keeps_its_number(
    traffic: list[CanFrame], lost: int, first: int, at_once: int
) -> None:
    decoder = CanStreamDecoder(3)
    got = joined(fed(decoder, without(traffic, first, lost), at_once))
    kept = np.delete(np.arange(6000), np.s_[first : first + lost])
    assert np.array_equal(got.sequence, kept)
    assert np.array_equal(got.device_time_us, 100 + kept * 1000)
    assert counted([got]) == {"samples_lost": lost, "sequence_gaps": 1}
    assert (decoder.counters.misnumbered, decoder.counters.unnumbered) == (0, 0)


def test_a_gap_of_ten_seconds_at_1000_hz_is_counted_exactly() -> None:
    frames = timed(object_at(), sample_packets(13_000), MS)
    decoder = CanStreamDecoder(3)
    got = joined(fed(decoder, without(frames, 1500, 10_000), 50))
    assert counted([got])["samples_lost"] == 10_000
    assert got.sequence[1500] == 11_500
    assert got.device_time_us[1500] == 100 + 11_500_000


@pytest.mark.parametrize("lost", LOSSES)
@pytest.mark.parametrize("first", [900, 960])
def test_the_sum_is_exact_even_where_no_time_of_reception_is_known(
    traffic: list[CanFrame], lost: int, first: int
) -> None:
    timeless = [dataclasses.replace(frame, host_time_ns=0) for frame in traffic]
    decoder = CanStreamDecoder(3)
    got = joined(fed(decoder, without(timeless, first, lost), 100_000))
    assert counted([got])["samples_lost"] == lost
    assert len(got.sequence) == 6000 - lost
    assert got.sequence[-1] == 5999


@pytest.mark.parametrize("lost", [1, 252, 253, 254, 255, 256, 257, 511, 3000])
@pytest.mark.parametrize("at_once", [7, 100_000])
def test_the_sum_is_exact_where_a_busy_computer_read_everything_late(
    traffic: list[CanFrame], lost: int, at_once: int
) -> None:
    # All in the queue already: the times of reception say nothing of when it was sent, nor where it is missing.
    pauses = np.random.default_rng(lost).exponential(20_000, len(traffic)).astype(int)
    late = [
        dataclasses.replace(frame, host_time_ns=at)
        for frame, at in zip(traffic, np.cumsum(pauses).tolist(), strict=True)
    ]
    decoder = CanStreamDecoder(3)
    got = joined(fed(decoder, without(late, 900, lost), at_once))
    found = counted([got])
    assert (found["samples_lost"], found["duplicates"], found["reordered"]) == (lost, 0, 0)
    assert len(got.sequence) == 6000 - lost


def test_losses_of_single_frames_of_every_kind_are_survived(traffic: list[CanFrame]) -> None:
    rng = np.random.default_rng(3)
    kept = rng.random(len(traffic)) > 0.05
    rows = set(sample_rows(traffic))
    numbers = [k for k, row in enumerate(sorted(rows)) if kept[row]]
    frames = [frame for row, frame in enumerate(traffic) if kept[row]]
    decoder = CanStreamDecoder(3)
    got = joined(fed(decoder, frames, 31))
    assert got.sequence.tolist() == numbers
    assert counted([got])["samples_lost"] == numbers[-1] - numbers[0] + 1 - len(numbers)
    assert np.array_equal(got.device_time_us, 100 + np.array(numbers) * 1000)


def test_a_stalled_host_makes_no_loss_of_late_frames(traffic: list[CanFrame]) -> None:
    # Frames 500-1999 all come at once, 1.5 s late: nothing is lost, and nothing may be counted so.
    late = [
        dataclasses.replace(frame, host_time_ns=max(frame.host_time_ns, 2_500_000_000))
        if frame.host_time_ns > 1_500_000_000
        else frame
        for frame in traffic
    ]
    decoder = CanStreamDecoder(3)
    got = joined(fed(decoder, late, 13))
    assert np.array_equal(got.sequence, np.arange(6000))


def test_a_listener_that_comes_in_the_middle_numbers_what_stood_before_the_first_time_frame(
    traffic: list[CanFrame],
) -> None:
    rows = sample_rows(traffic)
    got = joined(fed(CanStreamDecoder(3), traffic[rows[1001] :], 5))
    assert np.array_equal(got.sequence, np.arange(1001, 6000))


def test_samples_without_any_time_frame_are_dropped_and_counted(traffic: list[CanFrame]) -> None:
    frames = [traffic[row] for row in sample_rows(traffic)]
    decoder = CanStreamDecoder(3)
    assert fed(decoder, frames, 100) == []
    assert decoder.counters.unnumbered == 6000


def test_repeated_and_overtaken_frames_are_counted_and_delivered(traffic: list[CanFrame]) -> None:
    rows = sample_rows(traffic)
    frames = list(traffic)
    frames[rows[110]], frames[rows[111]] = frames[rows[111]], frames[rows[110]]
    frames.insert(rows[200], frames[rows[200]])
    decoder = CanStreamDecoder(3)
    got = joined(fed(decoder, frames, 100_000))
    assert counted([got]) == {"duplicates": 1, "reordered": 1, "sequence_gaps": 1}
    assert got.sequence[108:113].tolist() == [108, 109, 111, 110, 112]


def test_a_time_frame_that_overtakes_samples_changes_nothing(traffic: list[CanFrame]) -> None:
    frames = list(traffic)
    for row, frame in enumerate(frames):
        if frame.arbitration_id == arbitration_id(CanFunction.TIME, 3) and row > 20:
            frames[row - 4 : row + 1] = [frame, *frames[row - 4 : row]]
    decoder = CanStreamDecoder(3)
    got = joined(fed(decoder, frames, 9))
    assert np.array_equal(got.sequence, np.arange(6000))
    assert np.array_equal(got.device_time_us, 100 + np.arange(6000) * 1000)


def test_strangers_are_counted_and_ignored(traffic: list[CanFrame]) -> None:
    strangers = [
        CanFrame(0x001, b"1"),
        CanFrame(0x7FF, bytes(8)),
        CanFrame(arbitration_id(CanFunction.ORIENTATION, 3), bytes(8), FrameFlag.EXTENDED),
        CanFrame(0x1FFFFFFF, bytes(8), FrameFlag.EXTENDED),
        CanFrame(arbitration_id(CanFunction.ORIENTATION, 3), b"", FrameFlag.REMOTE, remote_length=8),
        CanFrame(0x04, bytes(8), FrameFlag.ERROR),
        CanFrame(arbitration_id(CanFunction.ORIENTATION, 3), bytes(7)),
        CanFrame(arbitration_id(CanFunction.TIME, 3), bytes(3)),
        CanFrame(arbitration_id(CanFunction.STATUS, 3), b""),
        CanFrame(arbitration_id(CanFunction.ORIENTATION, 3, True), bytes(20), FrameFlag.FD),
        CanFrame(arbitration_id(CanFunction.ORIENTATION, 9), bytes(8)),
        CanFrame(arbitration_id(CanFunction.COMMAND, 3), b"\x81\x01"),
        CanFrame(arbitration_id(CanFunction.COMMAND, 0), b"\x81\x01"),
    ]
    frames = []
    for row, frame in enumerate(traffic[:1000]):
        frames += [strangers[row % len(strangers)], frame]
    decoder = CanStreamDecoder(3)
    got = joined(fed(decoder, frames, 10))
    counters = decoder.counters
    assert len(got.sequence) == len(sample_rows(traffic[:1000]))
    assert counted([got])["samples_lost"] == 0
    times = [len(range(k, 1000, len(strangers))) for k in range(len(strangers))]
    assert counters.foreign_frames == sum(times[:4])
    assert counters.remote_frames == times[4]
    assert counters.error_frames == times[5]
    assert counters.wrong_lengths == sum(times[6:10])
    assert counters.other_node_frames == times[10] + times[12]
    assert counters.host_frames == times[11]


def test_codes_of_no_quaternion_are_malformed(traffic: list[CanFrame]) -> None:
    rows = sample_rows(traffic)
    frames = list(traffic)
    for row in rows[100:110]:
        frames[row] = dataclasses.replace(frames[row], data=frames[row].data[:1] + b"\xff" * 6 + b"\x3f")
    decoder = CanStreamDecoder(3)
    got = joined(fed(decoder, frames, 100))
    assert decoder.counters.malformed == 10
    assert len(got.sequence) == 5990


def test_several_objects_are_separate_streams() -> None:
    ends = {
        node: timed(object_at(node, node == 4, device_id=node), sample_packets(500 + node), MS) for node in (1, 4, 31)
    }
    mixed = sorted((frame for frames in ends.values() for frame in frames), key=lambda frame: frame.host_time_ns)
    for node in ends:
        decoder = CanStreamDecoder(node)
        assert np.array_equal(joined(fed(decoder, mixed, 17)).sequence, np.arange(500 + node))
        assert decoder.counters.other_node_frames == len(mixed) - len(ends[node])
        assert decoder.problems == ()
    first_heard = CanStreamDecoder()
    fed(first_heard, mixed, 50)
    assert first_heard.node == 1


@pytest.mark.parametrize("fd", [False, True])
def test_two_objects_with_one_id_are_detected_and_their_samples_refused(fd: bool) -> None:
    first = timed(object_at(3, fd, device_id=1), sample_packets(2000, first=100), MS)
    second = timed(object_at(3, fd, device_id=2), sample_packets(2000, first=40_000), MS)
    mixed = sorted(first + second, key=lambda frame: frame.host_time_ns)
    decoder = CanStreamDecoder(3)
    fed(decoder, mixed, 20)
    assert "two objects on the bus have node id 3" in decoder.problems[0]
    assert decoder.counters.refused > 3000


@pytest.mark.parametrize("fd", [False, True])
def test_a_reset_is_no_loss_and_no_conflict(fd: bool) -> None:
    frames = timed(object_at(3, fd, boot_id=1), sample_packets(1000), MS)
    frames += timed(object_at(3, fd, boot_id=2), sample_packets(1500), MS, 3_000_000_000)
    frames += timed(object_at(3, fd, boot_id=3), sample_packets(700, first=3000), MS, 6_000_000_000)
    for at_once in (13, 100_000):
        decoder = CanStreamDecoder(3)
        got = joined(fed(decoder, frames, at_once))
        expected = np.concatenate([np.arange(1000), np.arange(1500), 3000 + np.arange(700)])
        assert np.array_equal(got.sequence, expected)
        assert decoder.problems == ()


def test_after_the_link_was_cut_samples_have_their_numbers_again(traffic: list[CanFrame]) -> None:
    decoder = CanStreamDecoder(3)
    before = sample_rows(traffic[:1000])
    fed(decoder, traffic[:1000], 100)
    decoder.restart()
    got = joined(fed(decoder, traffic[3000:], 100))
    first = len(before) + len(sample_rows(traffic[1000:3000]))
    assert np.array_equal(got.sequence, np.arange(first, 6000))


def test_impossible_states_are_malformed(traffic: list[CanFrame]) -> None:
    state = arbitration_id(CanFunction.SAMPLE_STATE, 3)
    frames = [
        dataclasses.replace(frame, data=frame.data[:5] + b"\x00\x00" + frame.data[7:])
        if frame.arbitration_id == state and row > 500
        else frame
        for row, frame in enumerate(traffic)
    ]
    decoder = CanStreamDecoder(3)
    got = joined(fed(decoder, frames, 100))
    assert decoder.counters.malformed > 10
    assert len(got.sequence) == 6000


@pytest.mark.parametrize("fd", [False, True])
def test_one_frame_at_a_time_gives_the_same_to_the_last_bit(fd: bool) -> None:
    flags = np.where(np.arange(3000) % 700 < 90, 1, 8).astype(np.uint8)
    traffic = timed(object_at(3, fd), sample_packets(3000, first=65_000, flags=flags), MS)
    rows = sample_rows(traffic)
    frames = [frame for row, frame in enumerate(traffic) if row not in {rows[700], rows[2000], rows[2001]}]
    frames.insert(991, frames[990])
    bad = frames[rows[300]]
    frames[rows[300]] = dataclasses.replace(bad, data=bad.data[:1] + b"\xff" * 6 + b"\x3f" + bad.data[8:])
    decoders = [CanStreamDecoder(3) for _ in range(3)]
    one, *others = (joined(fed(decoder, frames, n)) for decoder, n in zip(decoders, (100_000, 1, 5), strict=True))
    assert len(one.sequence) == 2997
    for other in others:
        for name in ("sequence", "device_time_us", "quats_wxyz", "flags"):
            assert np.array_equal(getattr(one, name), getattr(other, name))
            assert getattr(one, name).dtype == getattr(other, name).dtype
    assert decoders[0].counters == decoders[1].counters == decoders[2].counters
    assert decoders[0].counters.malformed == counted([one])["duplicates"] == 1


@pytest.mark.parametrize("fd", [False, True])
def test_an_object_whose_filter_fails_is_rejected_and_every_other_sample_kept(fd: bool) -> None:
    packets = sample_packets(1000)
    for k in (100, 101, 500):
        packets[k] = packets[k][:7] + bytes(8) + packets[k][15:]  # no quaternion at all
    packets[700] = packets[700][:7] + b"\x00\x20" + bytes(6) + packets[700][15:]  # a quarter of the length
    frames = timed(object_at(3, fd), packets, MS)
    decoder = CanStreamDecoder(3)
    got = joined(fed(decoder, frames, 9))
    assert got.sequence.tolist() == [k for k in range(1000) if k not in (100, 101, 500, 700)]
    assert decoder.counters.malformed == 4
    assert counted([got])["samples_lost"] == 4  # the ledger takes the malformed ones off
