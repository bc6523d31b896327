"""An SLCAN (Lawicel) CAN adapter without I/O: the serial protocol between an adapter and its host.

Commands end with CR and are answered with CR (done) or BEL (refused); frames from the bus are lines of the same form
as those to send. CAN FD frames use the dialect of the CANable 2.0: ``d D`` without and ``b B`` with bit rate switch,
the length as the data length code in hex, ``Y2`` and ``Y5`` for the data bit rate.

Sources: LAWICEL CAN232 manual, version 3; canable.io, firmware ``canable2-fw``.
"""

from __future__ import annotations

from firmware_protocol.can.frames import FD_LENGTHS, CanFrame, FrameFlag

BITRATES = {
    "0": 10_000,
    "1": 20_000,
    "2": 50_000,
    "3": 100_000,
    "4": 125_000,
    "5": 250_000,
    "6": 500_000,
    "7": 750_000,
    "8": 1_000_000,
    "9": 83_300,
}
DATA_BITRATES = {"2": 2_000_000, "5": 5_000_000}
MAX_LINE_BYTES = 160
"""Longest command: an FD frame with 29-bit id; what is longer is refused whole."""
TIMESTAMP_MODULUS_MS = 60_000

_OK, _REFUSED = b"\r", b"\a"
_IDENTITY = {"V": b"V1013\r", "v": b"v0101\r", "N": b"NRD01\r"}
"""Answers to the questions for hardware version, firmware version and serial number."""
_SENT = {False: b"z\r", True: b"Z\r"}


def slcan_line(frame: CanFrame) -> bytes:
    """Return the line of a frame, without its end."""
    extended = bool(frame.flags & FrameFlag.EXTENDED)
    identifier = f"{frame.arbitration_id:08X}" if extended else f"{frame.arbitration_id:03X}"
    if frame.flags & FrameFlag.REMOTE:
        return f"{'R' if extended else 'r'}{identifier}{frame.remote_length:X}".encode()
    if frame.is_fd:
        kind = "b" if frame.flags & FrameFlag.BITRATE_SWITCH else "d"
        code = FD_LENGTHS.index(len(frame.data))
    else:
        kind, code = "t", len(frame.data)
    return f"{kind.upper() if extended else kind}{identifier}{code:X}{frame.data.hex().upper()}".encode()


class SlcanAdapter:
    """One adapter with its channel; bit rates are those last set, bit/s, None before."""

    greeting = b""

    def __init__(self) -> None:
        self._line = bytearray()
        self._overlong = False
        self.reset()

    def reset(self) -> None:
        """Power up."""
        self._line.clear()
        self._overlong = False
        self.is_open = False
        self.listens_only = False
        self.timestamps = False
        self.bitrate: int | None = None
        self.data_bitrate: int | None = None

    def hears(self, time_ms: int) -> bool:  # noqa: ARG002 (other adapters want a pause first)
        """Return whether the channel is open."""
        return self.is_open

    def from_bus(self, frame: CanFrame, time_ms: int) -> bytes:
        """Return what the adapter sends its host for a frame on the bus; nothing while the channel is closed."""
        if not self.is_open:
            return b""
        stamp = f"{time_ms % TIMESTAMP_MODULUS_MS:04X}".encode() if self.timestamps else b""
        return slcan_line(frame) + stamp + b"\r"

    def from_host(self, data: bytes) -> tuple[bytes, list[CanFrame]]:
        """Process bytes from the host; return the answers and the frames to put on the bus."""
        answers = bytearray()
        frames: list[CanFrame] = []
        for byte in data:
            if byte == 0x0A:  # LF is ignored, as adapters do
                continue
            if byte != 0x0D:
                self._overlong |= len(self._line) >= MAX_LINE_BYTES
                if not self._overlong:
                    self._line.append(byte)
                continue
            line, self._line = bytes(self._line), bytearray()
            answers += _REFUSED if self._overlong else self._command(line.decode("latin-1"), frames)
            self._overlong = False
        return bytes(answers), frames

    def _command(self, line: str, frames: list[CanFrame]) -> bytes:
        kind, rest = line[:1], line[1:]
        if kind == "":
            return _OK
        if kind in "tTrRdDbB":
            frame = _parse_frame(kind, rest)
            if frame is None or not self.is_open or self.listens_only:
                return _REFUSED
            frames.append(frame)
            return _SENT[bool(frame.flags & FrameFlag.EXTENDED)]
        if kind in "OL" and not rest:
            return self._open(listens_only=kind == "L")
        if kind == "C" and not rest:
            if not self.is_open:
                return _REFUSED
            self.is_open = False
            return _OK
        if line in _IDENTITY:
            return _IDENTITY[line]
        if kind == "F" and not rest:
            return b"F00\r" if self.is_open else _REFUSED
        return self._configure(kind, rest)

    def _open(self, *, listens_only: bool) -> bytes:
        if self.is_open:
            return _REFUSED
        self.is_open, self.listens_only = True, listens_only
        return _OK

    def _configure(self, kind: str, rest: str) -> bytes:
        if self.is_open:
            return _REFUSED
        if kind == "S" and rest in BITRATES:
            self.bitrate = BITRATES[rest]
        elif kind == "Y" and rest in DATA_BITRATES:
            self.data_bitrate = DATA_BITRATES[rest]
        elif kind == "Z" and rest in ("0", "1"):
            self.timestamps = rest == "1"
        elif (kind == "s" and len(rest) in (4, 6)) or (kind in "mM" and len(rest) == 8):
            pass  # bit timing registers and filters are accepted, and do nothing
        else:
            return _REFUSED
        return _OK


def _parse_frame(kind: str, rest: str) -> CanFrame | None:
    digits = 8 if kind.isupper() else 3
    extended = FrameFlag.EXTENDED if kind.isupper() else FrameFlag(0)
    if not all(character in "0123456789abcdefABCDEF" for character in rest) or len(rest) <= digits:
        return None
    identifier, code, data = int(rest[:digits], 16), int(rest[digits], 16), rest[digits + 1 :]
    if identifier >= (1 << 29 if extended else 1 << 11):
        return None
    if kind in "rR":
        return CanFrame(identifier, b"", extended | FrameFlag.REMOTE, remote_length=code) if code <= 8 else None
    flags = extended
    if kind in "dDbB":
        flags |= FrameFlag.FD | (FrameFlag.BITRATE_SWITCH if kind in "bB" else FrameFlag(0))
        length = FD_LENGTHS[code]
    elif code > 8:
        return None
    else:
        length = code
    return CanFrame(identifier, bytes.fromhex(data), flags) if len(data) == 2 * length else None
