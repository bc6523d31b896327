"""Static baselines as small TOML files."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from analysis.formats.text_table import plain
from analysis.sensor.baseline import AllanPoint, StaticBaseline
from analysis.series import BaselineError

FILE_FORMAT = 1
"""Version of the TOML layout."""
_MAX_FILE_BYTES = 1 << 20


def save_baseline(baseline: StaticBaseline, path: Path) -> None:
    """Write a baseline as TOML.

    Parameters
    ----------
    baseline
        What to write.
    path
        A file that does not exist yet.

    Raises
    ------
    FileExistsError
        It exists; a baseline is never overwritten.
    """
    lines = [
        "# Static baseline of a sensorized object: degrees, world axes.",
        f"format = {FILE_FORMAT}",
        f"rate_deg_per_min = {_numbers(baseline.rate_deg_per_min)}",
        f"rate_error_deg_per_min = {_numbers(baseline.rate_error_deg_per_min)}",
        f"noise_deg = {baseline.noise_deg!r}",
        f"walk_deg_per_sqrt_s = {baseline.walk_deg_per_sqrt_s!r}",
        f"duration_s = {baseline.duration_s!r}",
        f"n_samples = {baseline.n_samples}",
    ]
    if baseline.temperature_c is not None:
        lines.append(f"temperature_c = {_numbers(baseline.temperature_c)}")
    lines.append(f"source = {_quoted(baseline.source)}")
    lines.append(f"notes = [{', '.join(_quoted(note) for note in baseline.notes)}]")
    lines.append(f"allan_tau_s = {_numbers([point.tau_s for point in baseline.allan])}")
    lines.append(f"allan_deg_per_min = {_numbers([point.deviation_deg_per_min for point in baseline.allan])}")
    with path.open("x", encoding="utf-8") as file:
        file.write("\n".join(lines) + "\n")


def _numbers(values: Sequence[float]) -> str:
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def _quoted(text: str) -> str:
    """TOML basic string; control characters are not kept."""
    clean = plain(text, 500)
    return '"' + clean.replace("\\", "\\\\").replace('"', '\\"') + '"'


def load_baseline(path: Path) -> StaticBaseline:
    """Read a baseline from TOML.

    Parameters
    ----------
    path
        What :func:`save_baseline` wrote.

    Returns
    -------
    StaticBaseline

    Raises
    ------
    BaselineError
        Not a baseline file, or a value missing or impossible; names it.
    OSError
        The file cannot be opened.
    """
    name = plain(path.name, 80)
    if path.stat().st_size > _MAX_FILE_BYTES:
        raise BaselineError(f"{name} is too large for a baseline file")
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise BaselineError(f"{name} is not a baseline file: {plain(str(error), 120)}") from error
    if values.get("format") != FILE_FORMAT:
        raise BaselineError(
            f"{name} is not a baseline file of format {FILE_FORMAT}; measure one with `rotdrift baseline`"
        )
    reader = _Values(values, name)
    tau_s = reader.numbers("allan_tau_s", None)
    deviation = reader.numbers("allan_deg_per_min", len(tau_s))
    temperature = reader.numbers("temperature_c", 2) if "temperature_c" in values else None
    return StaticBaseline(
        rate_deg_per_min=reader.triple("rate_deg_per_min"),
        rate_error_deg_per_min=reader.triple("rate_error_deg_per_min"),
        noise_deg=reader.number("noise_deg"),
        walk_deg_per_sqrt_s=reader.number("walk_deg_per_sqrt_s"),
        duration_s=reader.number("duration_s"),
        n_samples=int(reader.number("n_samples")),
        allan=tuple(AllanPoint(tau, value) for tau, value in zip(tau_s, deviation, strict=True)),
        temperature_c=None if temperature is None else (temperature[0], temperature[1]),
        source=plain(str(values.get("source", "")), 500),
        notes=tuple(plain(str(note), 500) for note in values.get("notes", [])),
    )


@dataclass(frozen=True)
class _Values:
    """Values of a TOML file, checked as they are taken."""

    values: dict[str, object]
    name: str

    def number(self, key: str) -> float:
        value = self.values.get(key)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value) or value < 0:
            raise BaselineError(f"{self.name}: {key} is missing or no number ≥ 0; measure the baseline again")
        return float(value)

    def triple(self, key: str) -> tuple[float, float, float]:
        x, y, z = self.numbers(key, 3)
        return (x, y, z)

    def numbers(self, key: str, count: int | None) -> list[float]:
        found = self.values.get(key)
        values = found if isinstance(found, list) else None
        if values is None or (count is not None and len(values) != count):
            raise BaselineError(f"{self.name}: {key} is not a list of {count or 'some'} numbers; measure it again")
        if any(isinstance(v, bool) or not isinstance(v, (int, float)) or not math.isfinite(v) for v in values):
            raise BaselineError(f"{self.name}: {key} holds something that is no number; measure the baseline again")
        return [float(value) for value in values]
