"""The packets of the sensorized object: meanings with units, no bytes.

A *packet* is a meaning, a *frame* is how a link carries it. Everything here is frozen; the bytes are defined in
:mod:`firmware_protocol.schema` and tabulated in ``docs/protocol.md``.

Device -> host: :class:`Info`, :class:`Orientation` (in runs: :class:`OrientationBatch`), :class:`Status`,
:class:`RawImu`, :class:`Ack`, :class:`TimeReply`, :class:`Event`. Host -> device: the :class:`Command` classes, each
answered by one :class:`Ack` that repeats its ``command_id`` (``TimeRequest`` by a :class:`TimeReply`).
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import ClassVar, TypeAlias

import numpy as np
import numpy.typing as npt

PROTOCOL_MAJOR = 1
"""Objects that speak another major version are refused: the meaning of the bytes has changed."""
PROTOCOL_MINOR = 0
"""A newer minor version only adds packet types, or fields at the end of a packet; both are counted and skipped."""

DEVICE_CLOCK_MODULUS_US = 2**32
"""``device_time_us`` wraps after this many microseconds (71.58 min)."""
SEQUENCE_MODULUS = 2**16
"""``sequence`` wraps after this many samples (65.5 s at 1000 Hz)."""
MIN_RATE_HZ = 10
MAX_RATE_HZ = 1000


class PacketType(enum.IntEnum):
    """First byte of every packet. 0x01-0x7F travel device -> host, 0x81-0xFF host -> device."""

    INFO = 0x01
    ORIENTATION = 0x02
    STATUS = 0x03
    RAW_IMU = 0x04
    ACK = 0x05
    TIME_REPLY = 0x06
    EVENT = 0x07
    GET_INFO = 0x81
    START = 0x82
    STOP = 0x83
    SET_RATE = 0x84
    IDENTIFY = 0x85
    CALIBRATE = 0x86
    TIME_REQUEST = 0x87
    MARK = 0x88


class ObjectShape(enum.IntEnum):
    """Object type on the benchmark card."""

    UNKNOWN = 0
    CUBE = 1
    CYLINDER = 2
    SPHERE = 3
    OTHER = 255


class OrientationFlag(enum.IntFlag):
    """What the sensor reports of one sample."""

    STILL = 0x01  # the filter judges the object at rest
    OVERRANGE = 0x02  # the rate of turn is beyond the range in which the filter is accurate
    SATURATED = 0x04  # a gyro or accelerometer axis is at the end of its scale
    CALIBRATED = 0x08  # a static calibration has been done since power-up


class DeviceState(enum.IntEnum):
    """What the object is doing."""

    IDLE = 0
    STREAMING = 1
    CALIBRATING = 2
    FAULT = 3


class DeviceError(enum.IntFlag):
    """Error bits of STATUS; set until the next STATUS that no longer has the cause."""

    SENSOR = 0x0001  # the IMU does not answer or failed its self test
    CALIBRATION = 0x0002  # the last calibration failed: the object moved
    TRANSMIT_OVERFLOW = 0x0004  # samples were dropped since the last STATUS because the link was full
    LOW_BATTERY = 0x0008
    OVER_TEMPERATURE = 0x0010


class AckCode(enum.IntEnum):
    """The object's answer to a command: done, or why not."""

    OK = 0
    UNKNOWN_COMMAND = 1
    INVALID_ARGUMENT = 2
    WRONG_STATE = 3  # e.g. CALIBRATE while streaming, START while calibrating
    NOT_STILL = 4  # CALIBRATE while the object moves
    BUSY = 5
    HARDWARE_FAULT = 6


class EventKind(enum.IntEnum):
    """What happened at the object."""

    BUTTON = 0
    MARKER = 1  # a MARK command took effect; ``value`` repeats its marker


@dataclass(frozen=True, slots=True)
class InternalWeight:
    """One weight inside the object."""

    slot: int
    """Slot number, 0-255, as printed in the object."""
    mass_g: float
    """Mass in grams, 0-655.35 in steps of 0.01."""


@dataclass(frozen=True, slots=True)
class ObjectCard:
    """What the object knows of itself, as the benchmark card asks. Unknown numbers are NaN, unknown texts empty."""

    shape: ObjectShape = ObjectShape.UNKNOWN
    """Object type."""
    size_mm: tuple[float, float, float] = (float("nan"),) * 3
    """Cube: edge lengths x, y, z. Cylinder: diameter, length, NaN. Sphere: diameter, NaN, NaN. float32, mm."""
    surface: str = ""
    """Surface and material, UTF-8, at most 32 bytes."""
    mass_g: float = float("nan")
    """Total mass, float32, grams."""
    com_mm: tuple[float, float, float] = (float("nan"),) * 3
    """Centre of mass in the object frame, from the geometric centre, float32, mm."""
    weights: tuple[InternalWeight, ...] = ()
    """Internal weights, at most 8."""
    mounting_q_body_sensor: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    """Unit quaternion w, x, y, z that maps sensor to body coordinates, float32. ORIENTATION is already the body's."""


@dataclass(frozen=True, slots=True)
class Info:
    """Who the object is. Sent on GET_INFO and once after power-up."""

    packet_type: ClassVar[PacketType] = PacketType.INFO
    device_id: int
    """Unique and constant for one object, u64."""
    boot_id: int
    """Differs after every reset, u32."""
    firmware_version: tuple[int, int, int] = (0, 0, 0)
    """major, minor, patch, each u8."""
    rate_hz: int = 100
    """Orientation rate now set, 10-1000 Hz, u16."""
    name: str = ""
    """Name of the object, UTF-8, at most 32 bytes."""
    sensor: str = ""
    """IMU part, UTF-8, at most 24 bytes."""
    filter: str = ""
    """Orientation filter, UTF-8, at most 24 bytes."""
    card: ObjectCard = field(default_factory=ObjectCard)
    """The object's own card."""
    protocol_major: int = PROTOCOL_MAJOR
    """u8."""
    protocol_minor: int = PROTOCOL_MINOR
    """u8."""


@dataclass(frozen=True, slots=True)
class Orientation:
    """One orientation sample."""

    packet_type: ClassVar[PacketType] = PacketType.ORIENTATION
    sequence: int
    """Counts samples *produced*, also those the object then dropped; u16, wraps."""
    device_time_us: int
    """Device clock at the instant of the sample, u32, wraps."""
    q_wxyz: tuple[float, float, float, float]
    """Unit quaternion, body to world, 4 x int16 scaled by 32767; angle error at most 0.0035 deg."""
    flags: OrientationFlag = OrientationFlag(0)
    """What the sensor reports of the sample, u8."""


@dataclass(frozen=True, slots=True, eq=False)
class OrientationBatch:
    """A run of n consecutive ORIENTATION packets as arrays: the shape in which samples move everywhere."""

    sequence: npt.NDArray[np.uint16]
    """(n,), wraps."""
    device_time_us: npt.NDArray[np.uint32]
    """(n,), wraps."""
    quats_wxyz: npt.NDArray[np.float64]
    """(n, 4), unit, body to world."""
    flags: npt.NDArray[np.uint8]
    """(n,), bits of :class:`OrientationFlag`."""

    def __len__(self) -> int:
        return len(self.sequence)

    def part(self, piece: slice) -> OrientationBatch:
        """Cut out some of the packets, without copying."""
        return OrientationBatch(
            self.sequence[piece], self.device_time_us[piece], self.quats_wxyz[piece], self.flags[piece]
        )


@dataclass(frozen=True, slots=True)
class Status:
    """Health of the object, at least once a second while it streams; u64/u32 counters never wrap in practice."""

    packet_type: ClassVar[PacketType] = PacketType.STATUS
    uptime_us: int
    """Device clock without wrap, u64; its low 32 bits are ``device_time_us``."""
    state: DeviceState = DeviceState.IDLE
    """u8."""
    samples_produced: int = 0
    """Samples produced since boot, u64; the low 16 bits are the next ``sequence``."""
    samples_dropped: int = 0
    """Of these, dropped by the object itself because the link was full, u32."""
    battery_mv: int = 0
    """Battery voltage in mV, u16; 0 where there is no battery."""
    temperature_c: float = float("nan")
    """Sensor temperature, int16 in 0.01 degree Celsius; NaN is 0x8000."""
    gyro_bias_dps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The filter's bias estimate, deg/s, sensor axes, 3 x int16 in 0.001 deg/s."""
    errors: DeviceError = DeviceError(0)
    """u16."""


@dataclass(frozen=True, slots=True)
class RawImu:
    """Gyro and accelerometer of one sample; optional (START asks for it)."""

    packet_type: ClassVar[PacketType] = PacketType.RAW_IMU
    sequence: int
    """That of the ORIENTATION sample it belongs to, u16."""
    device_time_us: int
    """u32, wraps."""
    gyro_dps: tuple[float, float, float]
    """Rate of turn, deg/s, sensor axes, 3 x int16, full scale 2000."""
    acceleration_g: tuple[float, float, float]
    """Specific force in g (9.80665 m/s^2), sensor axes, 3 x int16, full scale 16."""


@dataclass(frozen=True, slots=True)
class Ack:
    """The object's answer to one command."""

    packet_type: ClassVar[PacketType] = PacketType.ACK
    command_type: int
    """The command's packet type byte, u8 (an int: it may be one the object does not know)."""
    command_id: int
    """That of the command, u8."""
    code: AckCode = AckCode.OK
    """u8."""


@dataclass(frozen=True, slots=True)
class TimeReply:
    """The answer to TIME_REQUEST: two readings of the device clock around the object's own delay."""

    packet_type: ClassVar[PacketType] = PacketType.TIME_REPLY
    command_id: int
    """That of the request, u8."""
    receive_uptime_us: int
    """Device clock when the request was received, u64, no wrap."""
    transmit_uptime_us: int
    """Device clock when this reply was handed to the link, u64, no wrap."""


@dataclass(frozen=True, slots=True)
class Event:
    """Something happened at the object."""

    packet_type: ClassVar[PacketType] = PacketType.EVENT
    device_time_us: int
    """u32, wraps."""
    kind: EventKind
    """u8."""
    value: int = 0
    """Button number or marker, u16."""


@dataclass(frozen=True, slots=True)
class _Command:
    """What all commands have."""

    command_id: int
    """Chosen by the host, repeated in the answer, u8."""


@dataclass(frozen=True, slots=True)
class GetInfo(_Command):
    """Ask for INFO; answered by ACK, then INFO."""

    packet_type: ClassVar[PacketType] = PacketType.GET_INFO


@dataclass(frozen=True, slots=True)
class Start(_Command):
    """Start streaming; the sequence goes on from where it was."""

    packet_type: ClassVar[PacketType] = PacketType.START
    with_raw_imu: bool = False
    """Also stream RAW_IMU, u8."""


@dataclass(frozen=True, slots=True)
class Stop(_Command):
    """Stop streaming."""

    packet_type: ClassVar[PacketType] = PacketType.STOP


@dataclass(frozen=True, slots=True)
class SetRate(_Command):
    """Set the orientation rate."""

    packet_type: ClassVar[PacketType] = PacketType.SET_RATE
    rate_hz: int
    """10-1000 Hz, u16; others are refused with INVALID_ARGUMENT."""


@dataclass(frozen=True, slots=True)
class Identify(_Command):
    """Blink, so that a person finds the object."""

    packet_type: ClassVar[PacketType] = PacketType.IDENTIFY
    duration_s: int = 3
    """u8."""


@dataclass(frozen=True, slots=True)
class Calibrate(_Command):
    """Estimate the gyro bias while the object is held still; refused with NOT_STILL otherwise."""

    packet_type: ClassVar[PacketType] = PacketType.CALIBRATE


@dataclass(frozen=True, slots=True)
class TimeRequest(_Command):
    """Ask for the device clock; answered by TIME_REPLY alone."""

    packet_type: ClassVar[PacketType] = PacketType.TIME_REQUEST


@dataclass(frozen=True, slots=True)
class Mark(_Command):
    """Put a marker into the stream; comes back as EVENT with the device time at which it took effect."""

    packet_type: ClassVar[PacketType] = PacketType.MARK
    marker: int = 0
    """u16."""


DevicePacket: TypeAlias = Info | Orientation | Status | RawImu | Ack | TimeReply | Event
Command: TypeAlias = GetInfo | Start | Stop | SetRate | Identify | Calibrate | TimeRequest | Mark
Packet: TypeAlias = DevicePacket | Command
