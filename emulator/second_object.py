"""A second object on a line that has room for one: it has an identity, a clock and a count of its own, and answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from emulator.device.clock import DeviceClock
from emulator.device.firmware import Firmware
from emulator.device.imu_model import ImuModel
from emulator.device.transmit_queue import Sink
from emulator.motion.rotation import FloatArray
from emulator.virtual_object import VirtualObject

_UPTIME_US = 1_234_567_890
_REST_Q_WXYZ = (0.5, 0.5, 0.5, 0.5)


class SecondObject:
    """Powers up now, streams at once and lies still; otherwise of the same make as the first.

    Parameters
    ----------
    first : VirtualObject
        Whose line it shares.
    now_s : float
        When, s.
    """

    def __init__(self, first: VirtualObject, now_s: float) -> None:
        scenario, seed = first.scenario, first.seed + 1
        settings = scenario.device
        self.device_id = settings.device_id ^ 2
        clock = DeviceClock(scenario.clock, seed)
        clock.step(now_s, _UPTIME_US - clock.read_us(now_s))
        self._firmware = Firmware(
            replace(settings, device_id=self.device_id, streams_from_power_up=True),
            ImuModel(scenario.imu, settings.card.mounting_q_body_sensor, seed),
            clock,
            _at_rest,
            seed,
        )
        self._firmware.power_up(now_s)

    @property
    def next_due_s(self) -> float:
        """When :meth:`step` has something to do next, s."""
        return self._firmware.next_due_s

    def step(self, now_s: float, sink: Sink) -> None:
        """Do all that is due by now and hand encoded packets to the link."""
        self._firmware.step(now_s, sink)

    def receive(self, command: bytes, now_s: float) -> None:
        """Process a command: it hears what the first one hears."""
        self._firmware.receive(command, now_s)


def _at_rest(times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.tile(_REST_Q_WXYZ, (len(times_s), 1)), np.zeros((len(times_s), 3))
