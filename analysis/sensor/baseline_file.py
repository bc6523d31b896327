"""Static baselines as small TOML files: :class:`StaticBaseline`, with the Allan deviation as two columns."""

from __future__ import annotations

import math
import tomllib
from dataclasses import asdict, replace
from pathlib import Path

import msgspec
import tomli_w

from analysis.formats.source import plain
from analysis.sensor.baseline import StaticBaseline
from analysis.series import BaselineError

FILE_FORMAT = 1
"""Version of the TOML layout."""
_HEADING = "# Static baseline of a sensorized object: degrees, world axes.\n"
_MAX_FILE_BYTES = 1 << 20


def save_baseline(baseline: StaticBaseline, path: Path) -> None:
    """Write a baseline as TOML; control characters in its texts are not kept.

    Raises
    ------
    FileExistsError
        It exists; a baseline is never overwritten.
    """
    values = {"format": FILE_FORMAT, **asdict(_plain_texts(baseline))}
    values["allan_tau_s"] = [point.tau_s for point in baseline.allan]
    values["allan_deg_per_min"] = [point.deviation_deg_per_min for point in baseline.allan]
    known = {key: value for key, value in values.items() if key != "allan" and value is not None}
    with path.open("x", encoding="utf-8") as file:
        file.write(_HEADING + tomli_w.dumps(known))


def load_baseline(path: Path) -> StaticBaseline:
    """Read a baseline as written by :func:`save_baseline`.

    Raises
    ------
    BaselineError
        Not a baseline file, or a value missing or impossible; names it.
    OSError
        The file cannot be opened.
    """
    name = plain(path.name, 80)
    with path.open("rb") as file:
        data = file.read(_MAX_FILE_BYTES + 1)
    if len(data) > _MAX_FILE_BYTES:
        raise BaselineError(f"{name} is too large for a baseline file")
    try:
        values = tomllib.loads(data.decode("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise BaselineError(f"{name} is not a baseline file: {plain(str(error), 120)}") from error
    if values.get("format") != FILE_FORMAT:
        raise BaselineError(
            f"{name} is not a baseline file of format {FILE_FORMAT}; measure one with `rotdrift baseline`"
        )
    try:
        columns = zip(values["allan_tau_s"], values["allan_deg_per_min"], strict=True)
        points = [{"tau_s": tau_s, "deviation_deg_per_min": deviation} for tau_s, deviation in columns]
        baseline = msgspec.convert({**values, "allan": points}, StaticBaseline)
    except KeyError as error:
        raise BaselineError(f"{name}: {error.args[0]} is missing; measure the baseline again") from error
    except (msgspec.ValidationError, TypeError, ValueError) as error:
        raise BaselineError(f"{name}: {plain(str(error), 120)}; measure the baseline again") from error
    amounts = baseline.noise_deg, baseline.walk_deg_per_sqrt_s, baseline.duration_s, baseline.n_samples
    others = *baseline.rate_deg_per_min, *baseline.rate_error_deg_per_min, *(baseline.temperature_c or ())
    allan = [value for point in baseline.allan for value in (point.tau_s, point.deviation_deg_per_min)]
    if min(amounts) < 0 or not all(map(math.isfinite, (*amounts, *others, *allan))):
        raise BaselineError(f"{name} holds a number that is negative or not finite; measure the baseline again")
    return _plain_texts(baseline)


def _plain_texts(baseline: StaticBaseline) -> StaticBaseline:
    """Return a baseline whose texts are safe to print."""
    notes = tuple(plain(note, 500) for note in baseline.notes)
    return replace(baseline, source=plain(baseline.source, 500), notes=notes)
