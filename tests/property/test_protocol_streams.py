"""Any bytes, any chunks, any damage: the same answers as the slow decoder, and nothing undamaged is lost."""

import itertools
import random

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from firmware_protocol.serial import batch
from firmware_protocol.serial import decoder as stream
from firmware_protocol.serial.framing import MAX_PIECE_BYTES
from tests.wire_streams import (
    assert_accounted,
    assert_same,
    decode_fast,
    decode_slowly,
    frame,
    odd_frames,
    orientation,
    other_packets,
)

steady = settings(derandomize=True, deadline=None, max_examples=80)


@st.composite
def streams(draw, max_runs=6, max_run=40):
    """Frames of all kinds, noise between them; numbers that jump, repeat and fall back."""
    rng = random.Random(draw(st.integers(0, 2**32)))
    parts = []
    sequence = draw(st.integers(0, 65535))
    for _ in range(draw(st.integers(0, max_runs))):
        for _ in range(draw(st.integers(0, max_run))):
            parts.append(frame(orientation(sequence, rng)))
            sequence += 1
        kind = draw(st.integers(0, 5))
        if kind == 0:
            parts.append(frame(other_packets(boot_id=draw(st.integers(7, 8)))[draw(st.integers(0, 5))]))
        elif kind == 1:
            parts.append(draw(st.sampled_from(odd_frames())))
        elif kind == 2:
            parts.append(draw(st.binary(max_size=40)))
        elif kind == 3:
            parts.append(bytes(rng.randrange(1, 256) for _ in range(draw(st.integers(250, 600)))))
        elif kind == 4:
            sequence += draw(st.sampled_from([-1, -2, -5, -300, 1, 3, 300, 40000]))
    return parts


@st.composite
def damaged(draw, parts):
    """The same bytes, some inserted, deleted, changed; cut anywhere."""
    data = bytearray(b"".join(parts))
    for _ in range(draw(st.integers(0, 6))):
        if not data:
            break
        at = draw(st.integers(0, len(data) - 1))
        kind = draw(st.integers(0, 3))
        if kind == 0:
            data[at] ^= draw(st.integers(1, 255))
        elif kind == 1:
            del data[at : at + draw(st.integers(1, 30))]
        elif kind == 2:
            data[at:at] = draw(st.binary(min_size=1, max_size=30))
        else:
            data[at] = 0
    cut = draw(st.integers(0, 30))
    return bytes(data[cut:])


@pytest.mark.parametrize(
    ("batch_bytes", "block_bytes"),
    [(1, 1 << 18), (1, 200), (500, 1 << 18), (10**9, 0)],
    ids=["together", "in small blocks", "mixed", "one by one"],
)
@given(data=st.data())
@steady
def test_every_way_of_decoding_agrees_with_the_slow_one(batch_bytes, block_bytes, data):
    content = data.draw(damaged(data.draw(streams())))
    chunks = data.draw(st.lists(st.integers(0, len(content)), max_size=8))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stream, "BATCH_BYTES", batch_bytes)
        patch.setattr(batch, "BLOCK_BYTES", block_bytes)
        fast = decode_fast(content, chunks)
    assert_same(fast, decode_slowly(content))
    assert_accounted(fast.counted)


@given(data=st.data())
@steady
def test_frames_read_one_at_a_time_agree_with_the_slow_decoder(data):
    """Reads that end where frames do, as live ones: good, damaged, malformed and others, the first one included."""
    rng = random.Random(data.draw(st.integers(0, 2**32)))
    reads = []
    for sequence in range(data.draw(st.integers(1, 30))):
        sample = frame(orientation(sequence, rng))
        kind = data.draw(st.integers(0, 5))
        if kind == 0:
            at = data.draw(st.integers(0, len(sample) - 1))
            sample = sample[:at] + bytes([data.draw(st.integers(0, 255))]) + sample[at + 1 :]
        elif kind == 1:
            sample = data.draw(st.sampled_from(odd_frames()))
        elif kind == 2:
            sample = data.draw(st.binary(min_size=19, max_size=19)).join([b"\0", b"\0"])
        elif kind == 3:
            sample = sample[1:] + b"\0"
        reads.append(sample)
    content = b"".join(reads)
    fast = decode_fast(content, list(itertools.accumulate(map(len, reads))))
    assert_same(fast, decode_slowly(content))
    assert_accounted(fast.counted)


@given(content=st.binary(max_size=2000), step=st.integers(1, 50))
@example(content=b"\x01" * 600, step=1)
@steady
def test_noise_never_raises_and_the_buffer_is_capped(content, step):
    decoder = stream.StreamDecoder()
    for at in range(0, len(content), step):
        decoder.feed(content[at : at + step])
        assert decoder.counters.pending_bytes <= MAX_PIECE_BYTES
    assert_accounted(decode_fast(content).counted)


@given(data=st.data())
@steady
def test_a_frame_with_its_own_delimiters_is_received_whatever_happens_around_it(data):
    """Damage touches some frames in any way; all others must come, in order."""
    rng = random.Random(data.draw(st.integers(0, 2**32)))
    frames = [frame(orientation(k, rng)) for k in range(data.draw(st.integers(1, 60)))]
    hit = data.draw(st.sets(st.integers(0, len(frames) - 1), max_size=10))
    parts = list(frames)
    for k in hit:
        kind = data.draw(st.integers(0, 3))
        at = data.draw(st.integers(0, len(parts[k]) - 1))
        if kind == 0:
            parts[k] = parts[k][:at] + bytes([parts[k][at] ^ data.draw(st.integers(1, 255))]) + parts[k][at + 1 :]
        elif kind == 1:
            parts[k] = parts[k][:at] + parts[k][at + data.draw(st.integers(1, 21)) :]
        elif kind == 2:
            parts[k] = parts[k][:at] + data.draw(st.binary(min_size=1, max_size=400)) + parts[k][at:]
        else:
            parts[k] = data.draw(st.binary(max_size=30))
    content = b"".join(parts)
    chunks = data.draw(st.lists(st.integers(0, len(content)), max_size=5))
    received = {item[1] for item in decode_fast(content, chunks).items if isinstance(item, tuple)}
    assert set(range(len(frames))) - hit <= received
