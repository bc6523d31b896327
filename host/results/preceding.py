"""Recordings that the authors' script worked through before one: what it left behind is part of their figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from analysis.scoring.choice import parse_endpoints
from analysis.series import FloatArray, ReaderError
from host.errors import FileError, UsageError
from host.results.any_file import ReadOptions, score_recording
from host.results.result import ScoreOptions

_EXAMPLE = "e.g. --preceding T42_cube_roll_1.csv=1175,1639,2099"


def preceding_endpoints(given: Sequence[str], reading: ReadOptions | None = None) -> tuple[FloatArray, ...]:
    """Return the end points of earlier recordings, (m, 4) each, in the order in which the script worked through them.

    Each is ``FILE``, whose end points are searched, or ``FILE=ENDPOINTS`` with rows, times or a CSV as for
    ``--endpoints``.

    Raises
    ------
    FileError
        No such recording.
    UsageError
        End points that do not fit it, or fewer than two of them.
    """
    found = []
    for text in given:
        path, options = _parsed(text)
        quats = score_recording(path, options, reading).result.endpoint_quats_wxyz
        if len(quats) < 2:
            raise UsageError(f"--preceding {path.name}: {len(quats)} end points, too few", f"give them; {_EXAMPLE}")
        found.append(quats)
    return tuple(found)


def _parsed(text: str) -> tuple[Path, ScoreOptions]:
    name, equals, chosen = text.rpartition("=")
    if not equals or Path(text).exists():
        return Path(text), ScoreOptions()
    try:
        return Path(name), ScoreOptions(endpoints=parse_endpoints(chosen))
    except (ReaderError, FileError) as error:
        raise UsageError(f"--preceding {name}: {error}", _EXAMPLE) from error
