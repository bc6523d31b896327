"""Scenarios: TOML files of what the hand does, how the object drifts, and what the sensor and the link do to it.

A dozen ship with the package; ``docs/emulator.md`` lists every key. A scenario is checked as a whole when it is loaded.
"""

from __future__ import annotations

import difflib
import tomllib
from dataclasses import dataclass, replace
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from emulator import ScenarioError
from emulator.device.clock import ClockSettings
from emulator.device.imu_model import ImuSettings
from emulator.device.settings import DeviceSettings
from emulator.faults.definitions import FaultSettings
from emulator.motion.hand_motion import DriftSettings, MotionSettings
from emulator.settings import Settings, integer, read_table, table, text

MAX_FILE_BYTES = 100_000


@dataclass(frozen=True)
class Scenario(Settings):
    """Everything a run needs but the link, the time and, if another is wanted, the seed."""

    purpose: str = text("")
    """What the scenario is for, one line."""
    seed: int = integer(1, 0, 2**32 - 1)
    """Seed of everything random."""
    motion: MotionSettings = table(MotionSettings)
    """What the hand does."""
    drift: DriftSettings = table(DriftSettings)
    """How far the object turns in the hand."""
    imu: ImuSettings = table(ImuSettings)
    """The sensor's faults."""
    clock: ClockSettings = table(ClockSettings)
    """The object's clock."""
    device: DeviceSettings = table(DeviceSettings)
    """The object and its firmware."""
    faults: FaultSettings = table(FaultSettings)
    """What goes wrong between the object and the host."""
    name: str = "unnamed"
    """Name of the shipped scenario, or stem of the file."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.drift.check_slip(self.motion.cycles)
        if not self.device.answers and self.motion.begins == "on-start":
            raise ScenarioError('an object that does not answer needs motion.begins = "at-power-up"')


def _shipped() -> dict[str, Traversable]:
    folder = resources.files("emulator") / "scenarios"
    return {entry.name.removesuffix(".toml"): entry for entry in folder.iterdir() if entry.name.endswith(".toml")}


def scenario_names() -> tuple[str, ...]:
    """Return the names of the shipped scenarios, sorted."""
    return tuple(sorted(_shipped()))


def load_scenario(name_or_path: str | Path) -> Scenario:
    """Load a shipped scenario by its name, or one from a TOML file.

    Parameters
    ----------
    name_or_path : str or Path
        A name of :func:`scenario_names`; anything with a ``.toml`` ending or a separator is a path.

    Raises
    ------
    ScenarioError
        Unknown name (lists all), no such file, too large, not TOML (names the line), or a value that is not allowed
        (names the key).
    """
    name = str(name_or_path)
    if isinstance(name_or_path, Path) or name.endswith(".toml") or "/" in name or "\\" in name:
        path = Path(name).expanduser()
        try:
            with path.open("rb") as file:
                data = file.read(MAX_FILE_BYTES + 1)
        except OSError as error:
            raise ScenarioError(f"cannot read scenario {path}: {error.strerror}") from error
        if len(data) > MAX_FILE_BYTES:
            raise ScenarioError(f"{path} is larger than {MAX_FILE_BYTES} bytes: it is not a scenario")
        return _parse(data, path.stem, str(path))
    shipped = _shipped()
    if name not in shipped:
        near = difflib.get_close_matches(name, shipped, n=1)
        guess = f"did you mean {near[0]}? There are" if near else "choose one of"
        names = ", ".join(sorted(shipped))
        raise ScenarioError(f"unknown scenario {name!r}: {guess} {names}, or give the path of a .toml file")
    return _parse(shipped[name].read_bytes(), name, f"scenario {name}")


def _parse(data: bytes, name: str, where: str) -> Scenario:
    try:
        document = tomllib.loads(data.decode())
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise ScenarioError(f"{where} is not TOML: {error}") from error
    try:
        scenario = read_table(Scenario, document)
    except ScenarioError as error:
        raise ScenarioError(f"{where}: {error}") from None
    return replace(scenario, name=name)
