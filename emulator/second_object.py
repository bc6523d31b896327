"""A second object on a line that has room for one: it has an identity, a clock and a count of its own, and answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from emulator.device.clock import DeviceClock
from emulator.device.firmware import Firmware
from emulator.device.imu_model import ImuModel
from emulator.motion.rotation import FloatArray
from emulator.virtual_object import VirtualObject

_UPTIME_US = 1_234_567_890
_REST_Q_WXYZ = (0.5, 0.5, 0.5, 0.5)


def second_object(first: VirtualObject, now_s: float) -> Firmware:
    """Power up an object of the same make as the first; it streams at once and lies still."""
    scenario, seed = first.scenario, first.seed + 1
    settings = scenario.device
    clock = DeviceClock(scenario.clock, seed)
    clock.step(now_s, _UPTIME_US - clock.read_us(now_s))
    firmware = Firmware(
        replace(settings, device_id=settings.device_id ^ 2, streams_from_power_up=True),
        ImuModel(scenario.imu, settings.card.mounting_q_body_sensor, seed),
        clock,
        _at_rest,
        seed,
    )
    firmware.power_up(now_s)
    return firmware


def _at_rest(times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.tile(_REST_Q_WXYZ, (len(times_s), 1)), np.zeros((len(times_s), 3))
