"""The object's samples: a timer that ticks by the object's own clock, and packed ORIENTATION and RAW_IMU packets.

Sample instants are whole ticks of the device clock; they do not depend on how the run is stepped. Samples are made
ahead in blocks, vectorised, and delivered when their time has come.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from emulator.device.clock import DeviceClock
from emulator.device.imu_model import ImuModel, Readings, TrueMotion
from emulator.motion.rotation import FloatArray
from firmware_protocol.codec import ORIENTATION_DTYPE
from firmware_protocol.packets import DEVICE_CLOCK_MODULUS_US, SEQUENCE_MODULUS, OrientationFlag, PacketType
from firmware_protocol.quantization import quats_to_q15
from firmware_protocol.wire_values import ACCELERATION_LSB_G, GYRO_LSB_DPS

_BLOCK = 256

_RAW_IMU_DTYPE = np.dtype(
    [
        ("type", "u1"),
        ("sequence", "<u2"),
        ("device_time_us", "<u4"),
        ("gyro", "<i2", (3,)),
        ("acceleration", "<i2", (3,)),
    ]
)

IntArray = npt.NDArray[np.int64]


def pack_orientations(
    sequence: IntArray, uptime_us: IntArray, quats_wxyz: FloatArray, flags: npt.NDArray[np.uint8]
) -> list[bytes]:
    """Encode n ORIENTATION packets at once; the same bytes as ``encode_packet`` returns one by one.

    Parameters
    ----------
    sequence, uptime_us : (n,)
        Counted and in us, without wrap.
    quats_wxyz : (n, 4)
        Unit.
    flags : (n,)
        Bits of OrientationFlag.
    """
    packed = np.empty(len(sequence), ORIENTATION_DTYPE)
    packed["type"] = PacketType.ORIENTATION
    packed["sequence"] = sequence % SEQUENCE_MODULUS
    packed["device_time_us"] = uptime_us % DEVICE_CLOCK_MODULUS_US
    packed["q"] = quats_to_q15(quats_wxyz)
    packed["flags"] = flags
    return _rows(packed)


def pack_raw_imu(sequence: IntArray, uptime_us: IntArray, readings: Readings) -> list[bytes]:
    """Encode n RAW_IMU packets at once; the same bytes as ``encode_packet`` returns one by one."""
    packed = np.empty(len(sequence), _RAW_IMU_DTYPE)
    packed["type"] = PacketType.RAW_IMU
    packed["sequence"] = sequence % SEQUENCE_MODULUS
    packed["device_time_us"] = uptime_us % DEVICE_CLOCK_MODULUS_US
    packed["gyro"] = np.rint(readings.gyro_dps / GYRO_LSB_DPS).clip(-0x8000, 0x7FFF)
    packed["acceleration"] = np.rint(readings.acceleration_g / ACCELERATION_LSB_G).clip(-0x8000, 0x7FFF)
    return _rows(packed)


def _rows(packed: npt.NDArray[np.void]) -> list[bytes]:
    data, size = packed.tobytes(), packed.dtype.itemsize
    return [data[start : start + size] for start in range(0, len(data), size)]


@dataclass(frozen=True, eq=False)
class SampleBlock:
    """A run of samples made ahead."""

    first: int
    """Number of the first one since boot."""
    times_s: FloatArray
    """(n,) true times, s."""
    samples: list[tuple[bytes, ...]]
    """n samples: ORIENTATION, and RAW_IMU where asked for."""


class SampleStream:
    """Sampling timer and packer; between START and STOP it streams, else only its clock runs."""

    def __init__(self, imu: ImuModel, clock: DeviceClock, true_motion: TrueMotion) -> None:
        self._imu, self._clock, self._true_motion = imu, clock, true_motion
        self.produced = 0
        """Samples produced since boot."""
        self.produced_before = 0
        """Samples produced in all boots before."""
        self.streaming = False
        self.with_raw_imu = False
        self.calibrated = False
        self._boot = 0
        self._rate_hz = 100
        self._origin_us = 0  # uptime of tick 0
        self._tick = 0  # next tick
        self._block: SampleBlock | None = None
        self._used = 0  # samples of the block already delivered
        self._next_block: SampleBlock | None = None

    def boot(self, boot: int, rate_hz: int, now_s: float) -> None:
        """Power up: everything as new but the clock, which the caller restarts."""
        self.produced_before += self.produced
        self._boot, self.produced, self.calibrated = boot, 0, False
        self.stop()
        self.set_rate(rate_hz, now_s)

    def set_rate(self, rate_hz: int, now_s: float) -> None:
        """Restart the timer at a rate, Hz; the next sample comes one period from now."""
        self._rate_hz, self._origin_us, self._tick = rate_hz, self._clock.read_us(now_s), 1
        self.invalidate()

    def start(self, now_s: float, with_raw_imu: bool) -> None:
        """Stream from the first tick after now."""
        self.with_raw_imu = with_raw_imu
        if not self.streaming:
            elapsed_us = self._clock.read_us(now_s) - self._origin_us
            self._tick = max(elapsed_us * self._rate_hz // 1_000_000, 0)
            while self._time_s(self._tick) <= now_s:
                self._tick += 1
        self.streaming = True
        self.invalidate()

    def stop(self) -> None:
        """Stop streaming; the timer runs on."""
        self.streaming = False
        self.invalidate()

    def is_still(self, now_s: float) -> bool:
        """Return whether the sensor finds the object at rest; CALIBRATE asks."""
        return self._imu.is_still(now_s, self._true_motion)

    def shift(self, by_us: int) -> None:
        """Follow a jump of the clock: the timer's instants stay where they are."""
        self._origin_us += by_us
        self.invalidate()

    def invalidate(self) -> None:
        """Forget samples made ahead: what they are made from has changed."""
        self._block, self._used, self._next_block = None, 0, None

    def _uptime_us(self, ticks: IntArray) -> IntArray:
        return self._origin_us + ticks * 1_000_000 // self._rate_hz

    def _time_s(self, tick: int) -> float:
        return float(self._clock.time_s(self._uptime_us(np.array([tick])).astype(np.float64))[0])

    def _ahead(self) -> SampleBlock:
        if self._block is None or self._used == len(self._block.samples):
            self._block = self._next_block or self._make(self._tick, self.produced)
            self._used, self._next_block = 0, None
        return self._block

    def _make(self, tick: int, first: int) -> SampleBlock:
        uptime_us = self._uptime_us(np.arange(tick, tick + _BLOCK))
        times_s = self._clock.time_s(uptime_us.astype(np.float64))
        readings = self._imu.read(times_s, self._true_motion, first, self._boot)
        sequence = first + np.arange(_BLOCK)
        flags = readings.flags | np.uint8(OrientationFlag.CALIBRATED if self.calibrated else 0)
        packets = [pack_orientations(sequence, uptime_us, readings.quats_wxyz, flags)]
        if self.with_raw_imu:
            packets.append(pack_raw_imu(sequence, uptime_us, readings))
        return SampleBlock(first, times_s, list(zip(*packets, strict=True)))

    def prepare(self) -> None:
        """Make the next block while there is time, so that no sample waits for it; changes nothing else."""
        if self._block is not None and self._next_block is None and 2 * self._used > _BLOCK:
            left = len(self._block.samples) - self._used
            self._next_block = self._make(self._tick + left, self.produced + left)

    @property
    def next_due_s(self) -> float:
        """True time of the next sample, s; infinite while not streaming."""
        return float(self._ahead().times_s[self._used]) if self.streaming else np.inf

    def take(self, now_s: float) -> SampleBlock | None:
        """Return the samples due by now, at most a block; None when there is none."""
        if not self.streaming:
            return None
        block, start = self._ahead(), self._used
        end = int(np.searchsorted(block.times_s, now_s, side="right"))
        if end <= start:
            return None
        self._used = end
        self.produced += end - start
        self._tick += end - start
        return SampleBlock(block.first + start, block.times_s[start:end], block.samples[start:end])
