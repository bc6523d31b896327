"""Scenario table ``[device]``: who the object is and how its firmware behaves."""

from __future__ import annotations

import math
from dataclasses import dataclass

from emulator import ScenarioError
from emulator.settings import Settings, choice, integer, number, switch, table, tables, text, vector
from firmware_protocol.packets import MAX_RATE_HZ, MIN_RATE_HZ, PROTOCOL_MAJOR, InternalWeight, ObjectCard, ObjectShape
from firmware_protocol.wire_values import MAX_WEIGHTS


@dataclass(frozen=True)
class WeightSettings(Settings):
    """Scenario table ``[[device.card.weights]]``: one weight inside the object."""

    slot: int = integer(0, 0, 255)
    """Slot number as printed in the object."""
    mass_g: float = number(0.0, 0.0, 655.35)
    """Mass, g."""


@dataclass(frozen=True)
class CardSettings(Settings):
    """Scenario table ``[device.card]``: what the object knows of itself; ``nan`` stands for unknown."""

    shape: str = choice("cube", "unknown", "cube", "cylinder", "sphere", "other")
    """Object type."""
    size_mm: tuple[float, float, float] = vector((60.0, 60.0, 60.0), 0.0, 10_000.0, may_be_nan=True)
    """Cube: edges. Cylinder: diameter, length, nan. Sphere: diameter, nan, nan. mm."""
    surface: str = text("PLA, 0.2 mm layers", 32)
    """Surface and material."""
    mass_g: float = number(142.5, 0.0, 100_000.0, may_be_nan=True)
    """Total mass, g."""
    com_mm: tuple[float, float, float] = vector((0.0, 0.0, -1.5), -10_000.0, 10_000.0, may_be_nan=True)
    """Centre of mass from the geometric centre, object frame, mm."""
    weights: tuple[WeightSettings, ...] = tables(WeightSettings)
    """Weights inside, at most 8."""
    mounting_q_body_sensor: tuple[float, float, float, float] = vector((1.0, 0.0, 0.0, 0.0), unit=True)
    """Sensor to body, unit quaternion w, x, y, z."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.weights) > MAX_WEIGHTS:
            raise ScenarioError(f"weights must be at most {MAX_WEIGHTS}, not {len(self.weights)}")

    def card(self) -> ObjectCard:
        """Return the card as INFO carries it."""
        return ObjectCard(
            shape=ObjectShape[self.shape.upper()],
            size_mm=self.size_mm,
            surface=self.surface,
            mass_g=self.mass_g,
            com_mm=self.com_mm,
            weights=tuple(InternalWeight(weight.slot, weight.mass_g) for weight in self.weights),
            mounting_q_body_sensor=self.mounting_q_body_sensor,
        )


@dataclass(frozen=True)
class DeviceSettings(Settings):
    """The object and its firmware."""

    name: str = text("virtual cube", 32)
    """Name of the object."""
    device_id: int = integer(0x0D21F7_0001, 0, 2**63 - 1)
    """Unique and constant for one object."""
    firmware_version: tuple[float, float, float] = vector((1, 0, 0), 0, 255)
    """major, minor, patch."""
    protocol_major: int = integer(PROTOCOL_MAJOR, 0, 255)
    """Protocol version that INFO claims; another one plays an object the host must refuse."""
    rate_hz: int = integer(100, MIN_RATE_HZ, MAX_RATE_HZ)
    """Orientation rate at power-up, Hz."""
    answers: bool = switch(True)
    """False: the object never answers a command and only streams."""
    streams_from_power_up: bool = switch(False)
    """True: streams without being asked."""
    transmit_queue_bytes: int = integer(4096, 256, 1_000_000)
    """Room for packets that the link has not accepted yet; beyond it whole samples are dropped and counted."""
    status_interval_s: float = number(0.5, 0.05, 1.0)
    """Time between STATUS packets, s."""
    calibration_s: float = number(2.0, 0.0, 60.0)
    """How long CALIBRATE takes, s."""
    battery_mv: int = integer(3900, 0, 65_535)
    """Battery voltage at power-up, mV; falls by 1 mV a minute. 0: no battery."""
    card: CardSettings = table(CardSettings)
    """The object's own card."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not all(float(part).is_integer() for part in self.firmware_version):
            raise ScenarioError("firmware_version must be a list of 3 whole numbers")
        if not self.answers and not self.streams_from_power_up:
            raise ScenarioError("answers = false needs streams_from_power_up = true, or the object would be silent")

    def battery_at(self, time_s: float) -> int:
        """Return the battery voltage at a time since power-up, mV."""
        return max(self.battery_mv - math.floor(time_s / 60.0), 0)
