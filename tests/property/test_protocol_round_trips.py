"""Every packet over its whole range: encoded, framed, decoded, the same; and any bytes at all decode or are refused."""

import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol import codec, schema
from firmware_protocol.errors import MalformedPacketError, UnknownPacketTypeError, UnsupportedVersionError
from firmware_protocol.packets import (
    Ack,
    AckCode,
    Calibrate,
    DeviceError,
    DeviceState,
    Event,
    EventKind,
    GetInfo,
    Identify,
    Info,
    InternalWeight,
    Mark,
    ObjectCard,
    ObjectShape,
    Orientation,
    OrientationFlag,
    PacketType,
    RawImu,
    SetRate,
    Start,
    Status,
    Stop,
    TimeReply,
    TimeRequest,
)
from firmware_protocol.quantization import Q15_MAX_ERROR_RAD
from firmware_protocol.serial.framing import MAX_PACKET_BYTES, FrameDecoder, encode_frame
from firmware_protocol.wire_values import ACCELERATION_LSB_G, GYRO_LSB_DPS, TO_WIRE, clean_text

steady = settings(derandomize=True, deadline=None, max_examples=100)
u8, u16, u32, u64 = (st.integers(0, 2**bits - 1) for bits in (8, 16, 32, 64))
i16 = st.integers(-32768, 32767)


@st.composite
def units(draw):
    parts = draw(st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: math.hypot(*q) > 1e-3))
    return tuple(part / math.hypot(*parts) for part in parts)


def texts(size):
    return (
        st.text(st.characters(exclude_categories=("Cs",)), max_size=size)
        .map(clean_text)
        .filter(lambda text: len(text.encode()) <= size)
    )


def f32(low):
    return st.one_of(st.just(math.nan), st.floats(low, width=32, allow_nan=False, allow_infinity=False))


def triples(numbers):
    return st.tuples(numbers, numbers, numbers)


def counts(lsb):
    return triples(i16.map(lambda count: count * lsb))


cards = st.builds(
    ObjectCard,
    shape=st.sampled_from(ObjectShape),
    size_mm=triples(f32(0.0)),
    surface=texts(32),
    mass_g=f32(0.0),
    com_mm=triples(f32(None)),
    weights=st.lists(st.builds(InternalWeight, u8, u16.map(lambda count: count / 100)), max_size=8).map(tuple),
)
PACKETS = {
    PacketType.INFO: st.builds(
        Info,
        u64,
        u32,
        st.tuples(u8, u8, u8),
        st.integers(10, 1000),
        texts(32),
        texts(24),
        texts(24),
        cards,
        st.just(1),
        u8,
    ),
    PacketType.ORIENTATION: st.builds(Orientation, u16, u32, units(), u8.map(OrientationFlag)),
    PacketType.STATUS: st.builds(
        Status,
        u64,
        st.sampled_from(DeviceState),
        u64,
        u32,
        u16,
        st.one_of(st.just(math.nan), st.integers(-32767, 32767).map(lambda count: count / 100)),
        triples(st.integers(-32767, 32767).map(lambda count: count / 1000)),
        u16.map(DeviceError),
    ),
    PacketType.RAW_IMU: st.builds(RawImu, u16, u32, counts(GYRO_LSB_DPS), counts(ACCELERATION_LSB_G)),
    PacketType.ACK: st.builds(Ack, u8, u8, st.sampled_from(AckCode)),
    PacketType.TIME_REPLY: st.builds(TimeReply, u8, u64, u64),
    PacketType.EVENT: st.builds(Event, u32, st.sampled_from(EventKind), u16),
    PacketType.GET_INFO: st.builds(GetInfo, u8),
    PacketType.START: st.builds(Start, u8, st.booleans()),
    PacketType.STOP: st.builds(Stop, u8),
    PacketType.SET_RATE: st.builds(SetRate, u8, u16),
    PacketType.IDENTIFY: st.builds(Identify, u8, u8),
    PacketType.CALIBRATE: st.builds(Calibrate, u8),
    PacketType.TIME_REQUEST: st.builds(TimeRequest, u8),
    PacketType.MARK: st.builds(Mark, u8, u16),
}


def test_every_packet_type_is_drawn():
    assert set(PACKETS) == set(PacketType)


@pytest.mark.parametrize("packet_type", list(PacketType))
@given(data=st.data())
@steady
def test_what_goes_in_comes_out(packet_type, data):
    packet = data.draw(PACKETS[packet_type])
    content = codec.encode_packet(packet)
    assert content == schema.build(packet_type, TO_WIRE[packet_type](packet)), "the fast way is the schema's way"
    assert FrameDecoder().feed(encode_frame(content)) == [content]
    decoded = codec.decode_packet(content)
    if isinstance(packet, Orientation):
        assert (decoded.sequence, decoded.device_time_us, decoded.flags) == (
            packet.sequence,
            packet.device_time_us,
            packet.flags,
        )
        assert 4.0 * math.asin(min(math.dist(decoded.q_wxyz, packet.q_wxyz) / 2, 1.0)) <= Q15_MAX_ERROR_RAD
    else:
        assert repr(decoded) == repr(packet)  # equality would not know NaN


@given(extra=st.binary(max_size=20), data=st.data())
@steady
def test_bytes_behind_the_last_field_change_nothing(extra, data):
    packet_type = data.draw(st.sampled_from(PacketType))
    content = codec.encode_packet(data.draw(PACKETS[packet_type]))
    assert repr(codec.decode_packet(content + extra)) == repr(codec.decode_packet(content))
    assert codec.is_extended(content + extra) == bool(extra)


@pytest.mark.parametrize("packet_type", list(PacketType))
@given(data=st.data())
@steady
def test_any_bytes_decode_or_are_refused_with_an_error_of_ours(packet_type, data):
    size = schema.PACKET_BYTES[packet_type]
    body = data.draw(st.binary(min_size=0, max_size=size + 3))
    try:
        packet = codec.decode_packet(bytes([packet_type]) + body)
    except (MalformedPacketError, UnsupportedVersionError):
        return
    assert len(body) >= size - 1
    if not isinstance(packet, Orientation | Info):  # their quaternions were scaled to unit norm
        assert repr(codec.decode_packet(codec.encode_packet(packet))) == repr(packet)


@given(content=st.binary(min_size=1, max_size=MAX_PACKET_BYTES))
@steady
def test_any_packet_survives_framing(content):
    frame = encode_frame(content)
    assert FrameDecoder().feed(frame) == [content]
    assert frame.count(0) == 2
    if content[0] not in set(PacketType):
        with pytest.raises(UnknownPacketTypeError):
            codec.decode_packet(content)


@given(components=st.tuples(i16, i16, i16, i16))
@steady
def test_every_orientation_on_the_wire_is_unit_or_refused(components):
    content = b"\x02" + bytes(6) + struct.pack("<4h", *components) + b"\0"
    norm = math.hypot(*components) / 32767
    if abs(norm - 1.0) <= 1e-2:
        packet = codec.decode_packet(content)
        assert math.hypot(*packet.q_wxyz) == pytest.approx(1.0, abs=4e-16)
        assert [q * norm * 32767 for q in packet.q_wxyz] == pytest.approx(components, abs=1e-9)
    else:
        with pytest.raises(MalformedPacketError):
            codec.decode_packet(content)
