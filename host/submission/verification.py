"""Verifying a submission: hashes, layout, and everything made again from the raw bytes.

A bundle holds its sources, and the same sources give the same bytes. So every other file is made again and compared:
tables and JSON number by number, figures by what they show, and the reports, made again with these figures, byte by
byte. Whoever alters a number, a file or a hash is found,
unless all sources and everything that follows from them were altered together: then it is another submission, whose
digest differs.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from analysis.reporting.errors import BundleError
from host.errors import FileError, HostError
from host.submission.bundle import MANIFEST, check_manifest, read_bundle, shown
from host.submission.contents import build_submission, made_with
from host.submission.drawn_comparison import NUMBER, ComparisonUnavailableError, shows_the_same
from host.submission.manifest import SCORE_VERSION, parse_submission
from host.submission.source import sources_in
from host.text import plain

ABSOLUTE, RELATIVE = 1e-9, 1e-14
"""Numbers that differ by less than either are equal: other processors round otherwise. Whole numbers are exact."""
MAX_DIFFERENCES = 20
"""Differences listed per file; the rest is counted."""
_PICTURE = re.compile(rb"data:image/[^\"]*|Size: [0-9.]+ MB")
REPORTS = ("report.html", "report.pdf")
FIGURES = (".png", ".svg", ".pdf")
"""Drawn files: comparing them is possible only with the same version of matplotlib."""


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
    """Versions that differ, and why something could not be compared."""
    uncompared: tuple[str, ...] = ()
    """Files that could not be compared; ``equal`` says nothing of them."""

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
    return verify_files(files, altered, drawings=drawings)


def verify_files(files: Mapping[str, bytes], altered: tuple[str, ...] = (), *, drawings: bool = True) -> Verification:
    """Verify the files of a submission, wherever they come from.

    Parameters
    ----------
    files : mapping
        Content by name, the manifest included.
    altered : tuple of str
        What :func:`~host.submission.bundle.check_manifest` found.
    drawings : bool
        As for :func:`verify_bundle`.
    """
    digest = hashlib.sha256(files[MANIFEST]).hexdigest()
    try:
        claimed = parse_submission(files.get("submission.json", b""))
        sources = sources_in(files)
    except ValueError as error:
        return Verification(digest, len(files), 0, altered, (plain(error, 400),), ())
    ours = made_with()
    names = dict.fromkeys((*ours, *claimed.made_with))
    other = {name for name in names if ours.get(name) != claimed.made_with.get(name)}
    notes = []
    if other:
        said = [
            f"{name} {claimed.made_with.get(name, 'none')} (here {ours.get(name, 'none')})"
            for name in names
            if name in other
        ]
        notes.append(f"made with other versions: {plain(', '.join(said), 400)}")
    differences = []
    if claimed.score_version != SCORE_VERSION:
        differences.append(f"score version {plain(claimed.score_version)}, this program computes {SCORE_VERSION}")
    comparison = _Comparison(files, other, drawings=drawings)
    try:
        built = build_submission(
            list(sources.values()),
            title=claimed.title,
            versions=claimed.made_with,
            drawings=drawings,
            accept=comparison.accepted,
        )
    except HostError as error:
        differences.append(f"the recordings cannot be scored again: {plain(error, 400)}")
        return Verification(digest, len(files), len(sources), altered, tuple(differences), tuple(notes))
    differences += comparison.differences(built.files)
    return Verification(
        digest, len(files), len(sources), altered, tuple(differences), (*notes, *comparison.why()),
        tuple(comparison.uncompared),
    )  # fmt: skip


class _Comparison:
    """Compares the files of a bundle with those made again."""

    def __init__(self, files: Mapping[str, bytes], other: set[str], *, drawings: bool) -> None:
        self.uncompared: dict[str, str] = {}
        """Name and reason."""
        self._files = files
        self._other = other
        self._drawings = drawings
        self._same: dict[str, bool] = {}

    def accepted(self, name: str, made: bytes) -> bytes:
        """Give the bundle's figure where it shows the same as ours: the reports hold its bytes."""
        claimed = self._files.get(name)
        if claimed is None or self._reason(name):
            # A foreign picture that cannot be compared is never opened.
            return made
        self._same[name] = shows_the_same(name, claimed, made)
        return claimed if self._same[name] else made

    def differences(self, made: Mapping[str, bytes]) -> list[str]:
        """Compare everything, in the order of the names."""
        found: list[str] = []
        for name in sorted((set(self._files) | set(made)) - {MANIFEST}):
            kind = Path(name).suffix
            if name not in made:
                reason = self._reason(name) if _is_drawn(name) or kind == ".parquet" else ""
                if reason:
                    self.uncompared[name] = reason
                else:
                    found.append(f"{shown(name)} does not belong to this submission")
            elif name not in self._files:
                found.append(f"{name} is missing")
            elif self._files[name] != made[name]:
                found += self._content(name, made[name])
        return found

    def why(self) -> list[str]:
        """Say what was not compared, and why."""
        reasons: dict[str, list[str]] = {}
        for name, reason in self.uncompared.items():
            reasons.setdefault(reason, []).append(name)
        return [
            f"NOT compared: {len(names)} file{'s' if len(names) > 1 else ''} ({reason})"
            for reason, names in reasons.items()
        ]

    def _content(self, name: str, made: bytes) -> list[str]:
        reason = self._reason(name)
        if reason:
            self.uncompared[name] = reason
            return []
        if name == "report.html" and "matplotlib" in self._other:
            self.uncompared[name] = "only its texts; the pictures were drawn by another version of matplotlib"
            same = _PICTURE.sub(b"", self._files[name]) == _PICTURE.sub(b"", made)
            return [] if same else [f"{name} is not what the data give"]
        if _is_drawn(name) or name.endswith(".parquet"):
            try:
                if name not in self._same:
                    same_library = "pyarrow" not in self._other
                    self._same[name] = shows_the_same(name, self._files[name], made, same_library=same_library)
            except ComparisonUnavailableError as error:
                self.uncompared[name] = f"needs {error}"
                return []
            return [] if self._same[name] else [f"{name} is not what the data give"]
        return [f"{name}: {what}" for what in _content_differences(name, self._files[name], made)]

    def _reason(self, name: str) -> str:
        """Say why a file cannot be compared; empty where it can."""
        if not self._drawings and _is_drawn(name):
            return "left out on request"
        if name in REPORTS and "rotdrift" in self._other:
            return "made by another version of rotdrift"
        if name != "report.html" and _is_drawn(name) and "matplotlib" in self._other:
            return "drawn by another version of matplotlib"
        if name.endswith(".parquet") and made_with().get("pyarrow") is None:
            return "needs pyarrow: pip install 'rotdrift[parquet]'"
        return ""


def _is_drawn(name: str) -> bool:
    return name in REPORTS or (name.endswith(FIGURES) and "figures/" in name)


def read_folder(folder: Path) -> dict[str, bytes]:
    """Read an unpacked bundle; links are refused.

    Raises
    ------
    BundleError
        A link, or more than a bundle may hold.
    """
    from host.submission.bundle import MAX_ENTRIES, MAX_TOTAL_BYTES

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


def _content_differences(name: str, claimed: bytes, made: bytes) -> list[str]:
    try:
        if name.endswith(".json"):
            found = list(_value_differences("", json.loads(claimed, object_pairs_hook=_once), json.loads(made)))
        elif name.endswith(".csv"):
            found = list(_table_differences(_rows(claimed), _rows(made)))
        else:
            return ["differs"]
        if not found and NUMBER.sub("#", claimed.decode()) != NUMBER.sub("#", made.decode()):
            found = ["the same values are written otherwise: order, spaces or line ends"]
    except (ValueError, OverflowError, csv.Error, RecursionError) as error:
        return [f"cannot be read ({plain(error)})"]
    if len(found) > MAX_DIFFERENCES:
        return [*found[:MAX_DIFFERENCES], f"and {len(found) - MAX_DIFFERENCES} more differences"]
    return found


def _once(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """Refuse a name that stands twice in an object: one reader takes the first value, the next one the last."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a name stands twice in one object")
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
    # Sequence numbers and counts are exact; a measured value may happen to be a whole number here and not there.
    whole = [all(row[place].isdigit() for row in made[1:] if place < len(row)) for place in range(len(made[0]))]
    for number, (one, other) in enumerate(zip(claimed, made, strict=True), start=1):
        if len(one) != len(other):
            yield f"line {number} has {len(one)} cells, recomputed {len(other)}"
            continue
        for place, (cell, again, column) in enumerate(zip(one, other, made[0], strict=False)):
            if cell != again and (whole[place] or not _equal(_number(cell), _number(again))):
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
        if isinstance(one, int) and isinstance(other, int):
            return one == other
        return math.isclose(one, other, rel_tol=RELATIVE, abs_tol=ABSOLUTE)
    return type(one) is type(other) and one == other


def _by(one: object, other: object) -> str:
    if isinstance(one, bool) or isinstance(other, bool):
        return ""
    if isinstance(one, int | float) and isinstance(other, int | float):
        return f" (differs by {one - other:+.3g})"
    return ""


def _shown(value: object) -> str:
    return plain(json.dumps(value, ensure_ascii=False) if not isinstance(value, str) else value, 80)
