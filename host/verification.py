"""Verifying a submission: hashes, layout, and everything made again from the raw bytes.

A bundle holds its sources, and the same sources give the same bytes. So every other file is made again and compared:
tables and JSON number by number, figures and reports byte by byte. Whoever alters a number, a file or a hash is found,
unless all sources and everything that follows from them were altered together: then it is another submission, whose
digest differs.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from analysis.reporting.bundle import MANIFEST, check_manifest, read_bundle, shown
from analysis.reporting.errors import BundleError
from host.errors import FileError, HostError
from host.plain_text import plain
from host.submission import build_submission, made_with
from host.submission_format import SCORE_VERSION, parse_submission
from host.submission_source import sources_in

TOLERANCE = 1e-9
"""Numbers that differ by less, absolutely or relatively, are equal: other processors round otherwise."""
MAX_DIFFERENCES = 20
"""Differences listed per file; the rest is counted."""
DRAWN = (".png", ".svg", ".pdf", ".html", ".parquet")
"""Files compared byte by byte, which is possible only with the same versions of the drawing libraries."""


@dataclass(frozen=True)
class Verification:
    """What verifying found."""

    digest: str
    """SHA-256 of the manifest: names the whole submission."""
    n_files: int
    """Files in the bundle."""
    n_trials: int
    """Trials in it."""
    altered: tuple[str, ...]
    """What does not fit the manifest."""
    differences: tuple[str, ...]
    """What comes out otherwise when made again, and by how much."""
    notes: tuple[str, ...]
    """What could not be compared, and why; versions that differ."""

    @property
    def equal(self) -> bool:
        """Whether everything that can be compared is equal."""
        return not self.altered and not self.differences


def verify_bundle(path: Path, *, drawings: bool = True) -> Verification:
    """Verify a bundle.

    Parameters
    ----------
    path : Path
        The zip, or a folder it was unpacked to.
    drawings : bool
        Whether to make figures and reports again too, which takes most of the time.

    Raises
    ------
    FileError
        It is refused or no bundle at all.
    """
    try:
        files = read_folder(path) if path.is_dir() else read_bundle(path)
        altered = check_manifest(files)
    except BundleError as error:
        raise FileError(f"{plain(path)}: {error}", "ask for the submission again") from error
    digest = hashlib.sha256(files[MANIFEST]).hexdigest()
    try:
        claimed = parse_submission(files.get("submission.json", b""))
        sources = sources_in(files)
    except ValueError as error:
        return Verification(digest, len(files), 0, altered, (plain(error, 400),), ())
    ours, notes = made_with(), []
    other = {name: used for name, used in claimed.made_with.items() if ours.get(name) != used}
    if other or ours.keys() != claimed.made_with.keys():
        named = ", ".join(f"{name} {used} (here {ours.get(name, 'none')})" for name, used in sorted(other.items()))
        notes.append(f"made with other versions: {plain(named)}")
    differences = []
    if claimed.score_version != SCORE_VERSION:
        differences.append(f"score version {plain(claimed.score_version)}, this program computes {SCORE_VERSION}")
    try:
        built = build_submission(
            list(sources.values()), title=claimed.title, versions=claimed.made_with, drawings=drawings
        )
    except HostError as error:
        differences.append(f"the recordings cannot be scored again: {plain(error, 400)}")
        return Verification(digest, len(files), len(sources), altered, tuple(differences), tuple(notes))
    found, uncompared = _compare(files, built.files, same_versions=not other, drawings=drawings)
    differences += found
    if uncompared:
        why = "made with other versions" if drawings else "left out on request"
        notes.append(f"{len(uncompared)} figures and reports were not compared: {why}")
    return Verification(digest, len(files), len(sources), altered, tuple(differences), tuple(notes))


def read_folder(folder: Path) -> dict[str, bytes]:
    """Read an unpacked bundle; links are refused.

    Raises
    ------
    BundleError
        A link, or more than a bundle may hold.
    """
    from analysis.reporting.bundle import MAX_ENTRIES, MAX_TOTAL_BYTES

    files: dict[str, bytes] = {}
    total = 0
    for place in sorted(folder.rglob("*")):
        name = place.relative_to(folder).as_posix()
        if place.is_symlink() or not (place.is_file() or place.is_dir()):
            raise BundleError(f"refused: {shown(name)} is a link or device, not a file")
        if place.is_dir():
            continue
        total += place.stat().st_size
        if total > MAX_TOTAL_BYTES or len(files) >= MAX_ENTRIES:
            raise BundleError("refused: more than a submission may hold")
        files[name] = place.read_bytes()
    return files


def _compare(
    files: Mapping[str, bytes], made: Mapping[str, bytes], *, same_versions: bool, drawings: bool
) -> tuple[list[str], list[str]]:
    differences: list[str] = []
    uncompared: list[str] = []
    for name in sorted((set(files) | set(made)) - {MANIFEST}):
        kind = Path(name).suffix
        if name not in made:
            if not drawings and kind in DRAWN:
                uncompared.append(name)
            else:
                differences.append(f"{shown(name)} does not belong to this submission")
        elif name not in files:
            differences.append(f"{name} is missing")
        elif files[name] == made[name]:
            continue
        elif kind in DRAWN:
            if same_versions:
                differences.append(f"{name} is not what the data give")
            else:
                uncompared.append(name)
        else:
            differences += [f"{name}: {what}" for what in _content_differences(name, files[name], made[name])]
    return differences, uncompared


def _content_differences(name: str, claimed: bytes, made: bytes) -> list[str]:
    try:
        if name.endswith(".json"):
            found = list(_value_differences("", json.loads(claimed), json.loads(made)))
        elif name.endswith(".csv"):
            found = list(_table_differences(_rows(claimed), _rows(made)))
        else:
            found = ["differs"]
    except (ValueError, OverflowError, csv.Error, RecursionError) as error:
        return [f"cannot be read ({plain(error)})"]
    if len(found) > MAX_DIFFERENCES:
        return [*found[:MAX_DIFFERENCES], f"and {len(found) - MAX_DIFFERENCES} more differences"]
    return found


def _value_differences(at: str, claimed: object, made: object) -> Iterator[str]:
    if isinstance(claimed, dict) and isinstance(made, dict):
        for key in dict.fromkeys([*made, *claimed]):
            place = f"{at}.{plain(key, 60)}" if at else plain(key, 60)
            if key not in claimed:
                yield f"{place} is missing"
            elif key not in made:
                yield f"{place} does not belong there"
            else:
                yield from _value_differences(place, claimed[key], made[key])
    elif isinstance(claimed, list) and isinstance(made, list):
        if len(claimed) != len(made):
            yield f"{at} has {len(claimed)} entries, recomputed {len(made)}"
            return
        for number, (one, other) in enumerate(zip(claimed, made, strict=True)):
            yield from _value_differences(f"{at}[{number}]", one, other)
    elif not _equal(claimed, made):
        yield f"{at} is {_shown(claimed)}, recomputed {_shown(made)}{_by(claimed, made)}"


def _table_differences(claimed: list[list[str]], made: list[list[str]]) -> Iterator[str]:
    if len(claimed) != len(made):
        yield f"{len(claimed)} lines, recomputed {len(made)}"
        return
    for number, (one, other) in enumerate(zip(claimed, made, strict=True), start=1):
        if len(one) != len(other):
            yield f"line {number} has {len(one)} cells, recomputed {len(other)}"
            continue
        for cell, again, column in zip(one, other, made[0], strict=False):
            if cell != again and not _equal(_number(cell), _number(again)):
                by = _by(_number(cell), _number(again))
                yield f"line {number}, {column}: {_shown(cell)}, recomputed {_shown(again)}{by}"


def _rows(data: bytes) -> list[list[str]]:
    return list(csv.reader(io.StringIO(data.decode("utf-8"), newline="")))


def _number(cell: str) -> float | str:
    try:
        return float(cell)
    except ValueError:
        return cell


def _equal(one: object, other: object) -> bool:
    if isinstance(one, bool) or isinstance(other, bool):
        return one is other
    if isinstance(one, int | float) and isinstance(other, int | float):
        return math.isclose(one, other, rel_tol=TOLERANCE, abs_tol=TOLERANCE)
    return type(one) is type(other) and one == other


def _by(one: object, other: object) -> str:
    if isinstance(one, bool) or isinstance(other, bool):
        return ""
    if isinstance(one, int | float) and isinstance(other, int | float):
        return f" (differs by {one - other:+.3g})"
    return ""


def _shown(value: object) -> str:
    return plain(json.dumps(value, ensure_ascii=False) if not isinstance(value, str) else value, 80)
