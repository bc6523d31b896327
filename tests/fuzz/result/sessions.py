"""Short sessions of virtual objects, as packets in the reads that deliver them: what the fuzzers start from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from emulator.virtual_object import VirtualObject
from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Command, GetInfo, Mark, Start, Stop, TimeRequest
from tests.recorded_trials import MONOTONIC_NS, scenario

READ_S = 0.1
DEVICE, OTHER = 0xA1, 0xB2


@dataclass(frozen=True)
class Delivery:
    """What one read of the link brought."""

    host_time_ns: int
    packets: tuple[bytes, ...]


@dataclass(frozen=True)
class Session:
    """What an object sent, and what it was sent."""

    name: str
    deliveries: tuple[Delivery, ...]
    commands: tuple[tuple[int, bytes], ...]
    """Host time in ns, and the packet."""


@cache
def sessions() -> tuple[Session, ...]:
    """Return the sessions: two objects, two boots of one of them, several rates, rest and motion."""
    quick = {"cycles": 5, "period_s": 0.4, "swing_deg": 20.0, "lead_in_s": 0.4, "lead_out_s": 0.4}
    calm = {**quick, "cycles": 3, "period_s": 0.8, "lead_in_s": 1.2}
    return (
        _run("plain", {"device_id": DEVICE, "rate_hz": 50}, quick),
        _run("booted again", {"device_id": DEVICE, "rate_hz": 50}, quick, seed=2),
        _run("raw", {"device_id": DEVICE, "rate_hz": 40}, quick, raw=True),
        _run("other", {"device_id": OTHER, "rate_hz": 100}, quick, seed=3),
        _run("slow", {"device_id": OTHER, "rate_hz": 20}, calm, seed=4),
    )


def _run(name: str, device: dict[str, int], motion: dict[str, float], raw: bool = False, seed: int = 1) -> Session:
    virtual = VirtualObject(scenario("ideal", motion=motion, device=device), seed)
    deliveries, commands, waiting, step, command_id = [], [], list[bytes](), 0, 0

    def sink(offered: Sequence[bytes]) -> int:
        waiting.extend(offered)
        return len(offered)

    def ask(command: Command, now_s: float) -> None:
        packet = encode_packet(command)
        commands.append((MONOTONIC_NS + round(now_s * 1e9), packet))
        virtual.firmware.receive(packet, now_s)

    virtual.firmware.step(0.0, sink)
    ask(GetInfo(1), 0.0)
    ask(Start(2, raw), 0.0)
    while step * READ_S < virtual.end_s:
        step += 1
        now_s = step * READ_S
        if step % 5 == 3:
            command_id = 3 + step % 200
            ask(Mark(command_id, step) if step % 3 == 0 else TimeRequest(command_id), now_s - READ_S / 2)
        virtual.firmware.step(now_s, sink)
        deliveries.append(Delivery(MONOTONIC_NS + round(now_s * 1e9), tuple(waiting)))
        waiting.clear()
    ask(Stop(255), step * READ_S)
    virtual.firmware.step((step + 1) * READ_S, sink)
    deliveries.append(Delivery(MONOTONIC_NS + round((step + 1) * READ_S * 1e9), tuple(waiting)))
    return Session(name, tuple(deliveries), tuple(commands))
