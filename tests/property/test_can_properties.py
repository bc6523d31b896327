"""CAN decoders on anything: garbage, cuts, losses."""

import dataclasses
import struct

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.can.decoder import CanStreamDecoder
from firmware_protocol.can.encoder import CanObject
from firmware_protocol.can.frames import CanFrame, FrameArray, FrameFlag, frame_array, pack_frames, unpack_frames
from firmware_protocol.can.mapping import NODE_BITS, CanFunction, arbitration_id
from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Ack, OrientationBatch, Status
from tests.can_traffic import answers, info_packet, joined, object_at, sample_packets, sample_rows, timed
from tests.sequence_oracle import counted

MS = 1_000_000
_TRAFFIC = {fd: timed(object_at(3, fd), sample_packets(3000), MS) for fd in (False, True)}
_RECORDS = {fd: frame_array(pack_frames(frames)) for fd, frames in _TRAFFIC.items()}
_ROWS = {fd: np.array(sample_rows(frames)) for fd, frames in _TRAFFIC.items()}
_FUNCTION_IDS = st.builds(arbitration_id, st.sampled_from(list(CanFunction)), st.integers(0, 31), st.booleans())


def frame_batch(records: FrameArray) -> bytes:
    """Frames as one batch; by the layout in can_frames."""
    return struct.pack("<2sBBI", b"CF", 1, records.dtype["data"].shape[0], len(records)) + records.tobytes()


@st.composite
def frames_of_any_kind(draw: st.DrawFn) -> CanFrame:
    fd = draw(st.booleans())
    flags = draw(st.sampled_from([FrameFlag(0), FrameFlag(0), FrameFlag.EXTENDED, FrameFlag.REMOTE, FrameFlag.ERROR]))
    if fd:
        flags |= FrameFlag.FD
    identifier = draw(st.one_of(_FUNCTION_IDS, st.integers(0, 2047), st.integers(0, 2**29 - 1)))
    is_remote = bool(flags & FrameFlag.REMOTE)
    data = b"" if is_remote else draw(st.binary(max_size=64 if fd else 8))
    length = draw(st.integers(0, 8)) if is_remote else 0
    return CanFrame(identifier, data, flags, draw(st.integers(0, 2**40)), draw(st.floats(0, 1e9)), length)


@given(st.lists(frames_of_any_kind(), max_size=60), st.integers(1, 20))
def test_no_frames_on_a_bus_ever_raise(frames: list[CanFrame], at_once: int) -> None:
    decoders, end = (CanStreamDecoder(), CanStreamDecoder(3)), CanObject(3)
    for start in range(0, len(frames), at_once):
        data = pack_frames(frames[start : start + at_once])
        assert unpack_frames(data) == frames[start : start + at_once]
        for decoder in decoders:
            decoder.feed(data)
        for frame in answers(frames[start : start + at_once]):
            end.receive(frame)
    for frame in frames:
        end.receive(frame)
    for decoder in decoders:
        decoder.flush()
        counters = decoder.counters
        strangers = counters.error_frames + counters.remote_frames + counters.foreign_frames
        assert counters.frames + counters.other_node_frames + strangers == len(frames)


@given(st.binary(max_size=200))
def test_bytes_that_are_no_batch_never_raise(data: bytes) -> None:
    CanStreamDecoder().feed(data)


@settings(max_examples=60, deadline=None)
@given(
    st.booleans(),
    st.lists(st.tuples(st.integers(0, 2900), st.integers(1, 700)), max_size=4),
    st.lists(st.integers(1, 400), min_size=1, max_size=20),
)
def test_every_sample_keeps_its_number_whatever_is_lost_and_however_frames_are_cut(
    fd: bool, losses: list[tuple[int, int]], cuts: list[int]
) -> None:
    records, rows = _RECORDS[fd], _ROWS[fd]
    kept = np.ones(len(records), bool)
    for first, count in losses:
        last = min(first + count - 1, 2999)
        kept[rows[first] : rows[last] + 1] = False
    frames = records[kept]
    numbers = np.flatnonzero(kept[rows])
    decoder = CanStreamDecoder(3)
    items = []
    start = step = 0
    while start < len(frames):
        cut = cuts[step % len(cuts)]
        items += decoder.feed(frame_batch(frames[start : start + cut]))
        start += cut
        step += 1
    items += decoder.flush()
    got = joined(items)
    # Samples before the first TIME frame with a long silence behind them have no number; there are 64 at most.
    missing = len(numbers) - len(got.sequence)
    assert missing == decoder.counters.unnumbered <= 64
    numbers = numbers[missing:]
    assert np.array_equal(got.sequence, numbers)
    assert np.array_equal(got.device_time_us, 100 + 1000 * numbers)
    if len(numbers):
        assert counted([got])["samples_lost"] == numbers[-1] - numbers[0] + 1 - len(numbers)


@settings(max_examples=40, deadline=None)
@given(st.booleans(), st.lists(st.integers(1, 50), min_size=1, max_size=10))
def test_packets_do_not_depend_on_how_frames_are_cut(fd: bool, cuts: list[int]) -> None:
    packets: list[bytes] = []
    for k, sample in enumerate(sample_packets(200)):
        packets.append(sample)
        if k % 40 == 10:
            packets += [encode_packet(Status(k * 1000, samples_produced=k)), encode_packet(Ack(0x82, k))]
    end = object_at(3, fd)
    frames = end.encode([*packets, info_packet()])

    def shape(items: list) -> list:
        flat: list = []
        for item in items:
            flat += item.sequence.tolist() if isinstance(item, OrientationBatch) else [item]
        return flat

    whole = shape(CanStreamDecoder(3).feed(pack_frames(frames)))
    decoder = CanStreamDecoder(3)
    parts: list = []
    start = step = 0
    while start < len(frames):
        cut = cuts[step % len(cuts)]
        parts += decoder.feed(pack_frames(frames[start : start + cut]))
        start += cut
        step += 1
    assert repr(shape(parts)) == repr(whole)  # repr: an unknown temperature is NaN
    assert len(whole) == 200 + 10


def test_host_time_alone_is_never_needed_to_number_what_was_not_lost() -> None:
    shuffled = np.random.default_rng(4).integers(0, 2**50, len(_TRAFFIC[False])).tolist()
    frames = [
        dataclasses.replace(frame, host_time_ns=time) for frame, time in zip(_TRAFFIC[False], shuffled, strict=True)
    ]
    got = joined(CanStreamDecoder(3).feed(pack_frames(frames)))
    assert np.array_equal(got.sequence[:2900], np.arange(2900))
    assert all(frame.arbitration_id >> NODE_BITS for frame in frames)
