"""Faults on packets and on framed bytes, seeded: the same run has the same faults however it is stepped.

Order on the way out: sample faults (wrong quaternions), frame faults (dropped, duplicated, reordered), then, after
framing, byte faults (bit flips, bursts, truncation, garbage).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np

from emulator.faults.definitions import FaultLog, FaultSettings
from firmware_protocol.codec import STREAMED
from firmware_protocol.packets import PacketType

_PACKET_STREAM, _BYTE_STREAM = 51, 52
_SAMPLE_TYPES = (PacketType.ORIENTATION, PacketType.RAW_IMU)
_LAYOUT = STREAMED[PacketType.ORIENTATION]
_MAX_GARBAGE = 40


def _name(packet: bytes) -> dict[str, Any]:
    """Return what the log calls a packet: its type, and its sequence (u16) if it is a sample."""
    packet_type = PacketType(packet[0])
    if packet_type in _SAMPLE_TYPES:
        return {"packet": packet_type.name, "sequence": int.from_bytes(packet[1:3], "little")}
    return {"packet": packet_type.name}


def byte_faults_in(settings: FaultSettings) -> tuple[str, ...]:
    """Return the names of the settings that damage bytes on the wire."""
    names = ("bit_error_rate", "burst_probability", "truncate_probability", "garbage_probability")
    return tuple(name for name in (*names, "garbage_before_bytes") if getattr(settings, name) > 0)


class PacketFaults:
    """Faults on encoded packets, seeded and noted in the log."""

    def __init__(self, settings: FaultSettings, seed: int, log: FaultLog) -> None:
        self._log = log
        self._rng = np.random.default_rng([seed, _PACKET_STREAM])
        self._held: bytes | None = None
        self.any = False
        """Whether a packet can be anything but let through; stays so once it was, for one may be waiting."""
        self.use(settings)

    def use(self, settings: FaultSettings) -> None:
        """Go on with other rates."""
        s = settings
        self._sample_limits = np.cumsum(
            [s.zero_quaternion_probability, s.wrong_norm_probability, s.sign_flip_probability]
        ).tolist()
        self._frame_limits = np.cumsum([s.drop_probability, s.duplicate_probability, s.reorder_probability]).tolist()
        self.any = self.any or self._sample_limits[-1] + self._frame_limits[-1] > 0.0

    def apply(self, packets: Iterable[bytes], now_s: float, *, active: bool) -> list[bytes]:
        """Return what becomes of packets, in order; where faults are not active, everything passes."""
        if not self.any:
            return list(packets)
        out: list[bytes] = []
        for packet in packets:
            if packet[0] not in _SAMPLE_TYPES:
                self._release(out)
                out.append(packet)
            elif not active:
                out.append(packet)
                self._release(out)
            else:
                self._sample(packet, now_s, out)
        return out

    def forget(self) -> None:
        """Lose a packet that waits to be reordered: the link was cut."""
        self._held = None

    def _release(self, out: list[bytes]) -> None:
        if self._held is not None:
            out.append(self._held)
            self._held = None

    def _sample(self, packet: bytes, now_s: float, out: list[bytes]) -> None:
        sample_chance, frame_chance = self._rng.random(2).tolist()
        if packet[0] == PacketType.ORIENTATION:
            packet = self._spoil(packet, sample_chance, now_s)
        drop, duplicate, reorder = self._frame_limits
        if frame_chance < drop:
            self._log.add("drop", now_s, **_name(packet))
        elif self._held is not None:  # the packet that overtakes
            out.append(packet)
            self._log.add("reorder", now_s, **_name(self._held))
            self._release(out)
        elif frame_chance < duplicate:
            self._log.add("duplicate", now_s, **_name(packet))
            out += [packet, packet]
        elif frame_chance < reorder:
            self._held = packet
        else:
            out.append(packet)

    def _spoil(self, packet: bytes, chance: float, now_s: float) -> bytes:
        zero, wrong_norm, flip = self._sample_limits
        if chance >= flip:
            return packet
        packet_type, sequence, time_us, w, x, y, z, flags = _LAYOUT.unpack(packet)
        if chance < zero:
            kind, quat = "zero-quaternion", (0, 0, 0, 0)
        elif chance < wrong_norm:
            kind, quat = "wrong-norm", (w // 2, x // 2, y // 2, z // 2)
        else:
            kind, quat = "sign-flip", (-w, -x, -y, -z)
        self._log.add(kind, now_s, **_name(packet))
        return _LAYOUT.pack(packet_type, sequence, time_us, *quat, flags)


class ByteFaults:
    """Faults on framed bytes, seeded and noted in the log; see :data:`emulator.links.byte_stream.Tamper`."""

    def __init__(self, settings: FaultSettings, seed: int, log: FaultLog) -> None:
        self._log = log
        self._rng = np.random.default_rng([seed, _BYTE_STREAM])
        self.use(settings)
        self.active = False
        """Whether rates act now."""
        self.now_s = 0.0
        """For the log, s."""
        self.damaged: Counter[str] = Counter()
        """Frames that cannot be whole any more, by packet type."""
        self._first = True

    def use(self, settings: FaultSettings) -> None:
        """Go on with other rates."""
        self._settings = settings
        self.any = bool(byte_faults_in(settings))

    def garbage(self, n: int) -> bytes:
        """Return n random bytes."""
        return self._rng.bytes(n)

    def __call__(self, packet: bytes, frame: bytes) -> bytes:
        """Return what goes out in place of a frame."""
        before = b""
        if self._first:
            self._first = False
            if self._settings.garbage_before_bytes:
                before = self.garbage(self._settings.garbage_before_bytes)
                self._log.add("garbage", self.now_s, len(before))
        if not self.active:
            return before + frame
        s = self._settings
        burst, truncate, garbage = self._rng.random(3).tolist()
        if garbage < s.garbage_probability:
            noise = self.garbage(int(self._rng.integers(1, _MAX_GARBAGE + 1)))
            self._log.add("garbage", self.now_s, len(noise))
            before += noise
        damaged = self._flip(frame, packet, burst=burst < s.burst_probability)
        if truncate < s.truncate_probability:
            # At least its last byte of data goes, so that it cannot be whole, and its first comes: else it is lost.
            cut = int(self._rng.integers(2, len(frame) - 1))
            self._log.add("truncate", self.now_s, len(frame) - cut, **_name(packet))
            damaged = damaged[:cut]
        if damaged != frame:
            self.damaged[PacketType(packet[0]).name] += 1
        return before + damaged

    def _flip(self, frame: bytes, packet: bytes, *, burst: bool) -> bytes:
        n_bits = 8 * len(frame)
        n_flips = int(self._rng.binomial(n_bits, self._settings.bit_error_rate)) if self._settings.bit_error_rate else 0
        if not n_flips and not burst:
            return frame
        bits = np.zeros(n_bits, dtype=np.uint8)
        if n_flips:
            bits[self._rng.choice(n_bits, n_flips, replace=False)] = 1
            self._log.add("bit-flips", self.now_s, n_flips, **_name(packet))
        if burst:
            length = min(self._settings.burst_bits, n_bits)
            start = int(self._rng.integers(0, n_bits - length + 1))
            pattern = self._rng.integers(0, 2, length, dtype=np.uint8)
            pattern[0] = pattern[-1] = 1
            bits[start : start + length] = pattern
            self._log.add("burst", self.now_s, length, **_name(packet))
        return (np.frombuffer(frame, dtype=np.uint8) ^ np.packbits(bits)).tobytes()
