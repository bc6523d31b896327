"""What is noticed on a CAN bus beside frames of objects: errors, overruns, outages, a parser that stumbled."""

from __future__ import annotations

from dataclasses import dataclass, field

from firmware_protocol.can.frames import CanFrame

# Classes and details of error frames, as Linux defines them (include/uapi/linux/can/error.h).
_CONTROLLER = 0x004
_NO_ACKNOWLEDGE = 0x020
_BUS_OFF = 0x040
_RESTARTED = 0x100
_RECEIVE_OVERFLOW = 0x01
_SEND_OVERFLOW = 0x02
_WARNING = 0x04 | 0x08
_PASSIVE = 0x10 | 0x20
_ACTIVE = 0x40


@dataclass(slots=True)
class BusHealth:
    """Counters and state of one bus."""

    state: str = "active"
    """``active``, ``warning``, ``passive`` or ``bus-off``, as error frames or the driver show; else it stays active."""
    error_frames: int = 0
    unexplained: int = 0
    """Of these, those of interfaces that do not explain the error."""
    overruns: int = 0
    """Times the controller lost frames because nobody read them."""
    dropped_frames: int = 0
    """Frames the kernel had no room for because nobody read them; SocketCAN and udp_multicast count them."""
    unsent: int = 0
    """Times the controller had no room for a frame to be sent."""
    unacknowledged: int = 0
    """Frames sent that no other node acknowledged."""
    passives: int = 0
    """Times the controller became error-passive: many frames failed, or nobody else is on the bus."""
    bus_offs: int = 0
    went_down: bool = False
    """Whether the interface was ever down meanwhile."""
    parser_errors: int = 0
    """Lines from the adapter that python-can could not read."""
    reopens: int = 0
    """How often the bus was opened again to go on."""
    filtered_frames: int = 0
    """Data frames with a 29-bit id, or of others where the link names a node: left out."""
    other_nodes: set[int] = field(default_factory=set)
    """Node ids of other objects heard."""

    def bus_off(self) -> None:
        """Note that the controller has left the bus."""
        self.bus_offs += self.state != "bus-off"
        self.state = "bus-off"

    def error_frame(self, frame: CanFrame, interface: str) -> None:
        """Note an error frame; only SocketCAN explains the error."""
        self.error_frames += 1
        if interface != "socketcan":
            self.unexplained += 1
            return
        kind = frame.arbitration_id & 0x1FFFFFFF
        detail = frame.data[1] if len(frame.data) > 1 else 0
        if kind & _BUS_OFF:
            self.bus_off()
        elif kind & _RESTARTED:
            self.state = "active"
        if kind & _CONTROLLER:
            self.overruns += bool(detail & _RECEIVE_OVERFLOW)
            self.unsent += bool(detail & _SEND_OVERFLOW)
            if detail & _PASSIVE:
                self.state = "passive"
                self.passives += 1
            elif detail & _WARNING:
                self.state = "warning"
            elif detail & _ACTIVE:
                self.state = "active"
        self.unacknowledged += bool(kind & _NO_ACKNOWLEDGE)

    def problems(self, name: str) -> tuple[str, ...]:
        """Return what a person should know, a sentence each; without numbers, so that each is reported once.

        They only ever grow: what is over is reported all the same, however seldom somebody asks.
        """
        channel = name.partition("?")[0].rpartition(":")[2]
        check = "check bit rate, wiring and termination"
        found = (
            (self.went_down, f"{name} went down: bring it up with `sudo ip link set {channel} up`"),
            (self.bus_offs, f"{name} went bus-off: {check}, then restart the interface"),
            (self.passives, f"{name} became error-passive: {check}"),
            (
                self.unacknowledged,
                f"nobody on {name} acknowledges frames: check wiring, termination and the object's power",
            ),
            (self.overruns, f"the CAN controller of {name} lost frames because this computer was too slow"),
            (
                self.dropped_frames,
                f"frames from {name} were lost because this computer was too slow: end other programs, or raise "
                "net.core.rmem_max (sysctl)",
            ),
            (self.unsent, f"the CAN controller of {name} has no room for frames to be sent: the bus is too busy"),
            (self.unexplained, f"{name} reports errors on the bus: {check}"),
            (
                self.parser_errors,
                f"what came from {name} could not all be read: check that it is a CAN adapter, its cable and baud rate",
            ),
        )
        return tuple(sentence for happened, sentence in found if happened)
