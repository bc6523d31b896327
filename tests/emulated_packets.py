"""What a virtual object sends in a trial, in virtual time, without any link."""

from __future__ import annotations

from collections.abc import Sequence

from emulator.scenario import load_scenario
from emulator.virtual_object import VirtualObject
from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Start


def trial_packets(scenario: str, seconds: float) -> list[bytes]:
    """Return the encoded packets of a trial that is started at once."""
    virtual = VirtualObject(load_scenario(scenario))
    sent: list[bytes] = []

    def sink(offered: Sequence[bytes]) -> int:
        sent.extend(offered)
        return len(offered)

    virtual.firmware.step(0.0, sink)
    virtual.firmware.receive(encode_packet(Start(1)), 0.0)
    for step in range(1, int(seconds * 20) + 1):
        virtual.firmware.step(step / 20, sink)
    return sent
