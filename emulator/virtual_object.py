"""A virtual sensorized object in a hand: motion, sensor, clock and firmware of one scenario, and the truth of it."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from emulator.device.clock import DeviceClock
from emulator.device.firmware import Firmware
from emulator.device.imu_model import ImuModel
from emulator.device.sample_stream import SampleBlock
from emulator.motion.hand_motion import HandMotion
from emulator.motion.rotation import FloatArray
from emulator.scenario import Scenario
from emulator.truth import FORMAT, EndpointWatch


class VirtualObject:
    """The object and the hand that moves it; powered up at time 0.

    A pure function of given time, commands and seed: it has no clock, no I/O and sleeps nowhere.

    Without a seed, everything random follows the scenario's.
    """

    def __init__(self, scenario: Scenario, seed: int | None = None) -> None:
        self.scenario = scenario
        self.seed = scenario.seed if seed is None else seed
        self.motion = HandMotion(scenario.motion, scenario.drift, self.seed)
        self.hand_start_s: float | None = None
        """When the hand's timeline started, s since power-up; None while it waits for the first START."""
        self.endpoints_met = 0
        """Grows whenever the truth has something new about an end point."""
        clock = DeviceClock(scenario.clock, self.seed)
        self._primary = EndpointWatch(self.motion.primary(), clock)
        self._other = EndpointWatch(self.motion.other(), clock)
        self.firmware = Firmware(
            scenario.device,
            ImuModel(scenario.imu, scenario.device.card.mounting_q_body_sensor, self.seed),
            clock,
            self.true_motion,
            self.seed,
            on_start=self._on_start,
            on_samples=self._on_samples,
        )
        """The object's state machine: it is stepped, commanded, and faults act on it."""
        if scenario.motion.begins == "at-power-up":
            self._start_hand(0.0)
        self.firmware.power_up(0.0)

    def _on_start(self, now_s: float) -> None:
        if self.hand_start_s is None:
            self._start_hand(now_s)

    def _start_hand(self, now_s: float) -> None:
        self.hand_start_s = now_s
        self._primary.start(now_s)
        self._other.start(now_s)

    def _on_samples(self, block: SampleBlock, boot: int) -> None:
        self.endpoints_met += self._primary.feed(block, boot) + self._other.feed(block, boot)

    def true_motion(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the true motion at times since power-up; see :data:`emulator.device.imu_model.TrueMotion`."""
        motion_times_s = np.zeros_like(times_s) if self.hand_start_s is None else times_s - self.hand_start_s
        return self.motion.orientation(motion_times_s), self.motion.angular_velocity(motion_times_s)

    @property
    def end_s(self) -> float:
        """When the hand's timeline is over, s since power-up; infinite while it has not started."""
        return np.inf if self.hand_start_s is None else self.hand_start_s + self.motion.duration_s

    def truth(self) -> dict[str, Any]:
        """Return what is true of the run so far, ready for JSON; see :mod:`emulator.truth`."""
        scenario = self.scenario
        primary = self._primary.document()
        return {
            "format": FORMAT,
            "scenario": scenario.name,
            "purpose": scenario.purpose,
            "seed": self.seed,
            "n_cycles": scenario.motion.cycles,
            "period_s": scenario.motion.period_s,
            "swing_deg": scenario.motion.swing_deg,
            "motion_axis": list(scenario.motion.axis),
            "hand_start_s": self.hand_start_s,
            "hand_end_s": None if self.hand_start_s is None else self.end_s,
            "theta_bar_deg": primary["theta_bar_deg"],
            "axis": primary["axis"],
            "steps_deg": primary["steps_deg"],
            "primary": primary["kind"],
            "endpoints": primary["endpoints"],
            "other_extreme": self._other.document(),
            "sensor": {
                "heading_drift_deg_per_min": scenario.imu.heading_drift_deg_per_min,
                "noise_deg": scenario.imu.noise_deg,
                "correlated_noise_deg": scenario.imu.correlated_noise_deg,
            },
            "clock": {
                "skew_ppm": scenario.clock.skew_ppm,
                "wander_ppm": scenario.clock.wander_ppm,
                "start_us": scenario.clock.start_us,
            },
            "device": {
                "device_id": scenario.device.device_id,
                "boot_ids": list(self.firmware.boot_ids),
                **asdict(self.firmware.counters),
            },
        }
