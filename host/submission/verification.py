"""Verifying a submission: hashes, layout, and every file made again from the raw bytes.

A bundle holds its sources, and the same sources give the same bytes under the same versions. So every other file is
made again: tables and JSON are compared number by number, drawings, reports and parquet byte by byte. Where their bytes
differ and other versions made them, nothing is known, and the file is named as not compared.
Whoever alters a number, a file or a hash is found, unless all sources and everything that follows from them were
altered together: then it is another submission, whose digest differs.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from msgspec import structs

from analysis.scoring.result import parse_result, result_text
from host.errors import FileError, HostError
from host.submission.bundle import MANIFEST, BundleError, check_manifest, read_bundle, read_folder
from host.submission.contents import build_submission
from host.submission.differences import content_differences
from host.submission.made_with import PARQUET, decides, is_drawn, made_with, other_versions
from host.submission.manifest import SCORE_VERSION, parse_submission
from host.submission.source import sources_in
from host.text import plain


@dataclass(frozen=True)
class Verification:
    """What verifying found."""

    digest: str
    """SHA-256 of the manifest: names the whole submission."""
    n_files: int
    n_trials: int
    altered: tuple[str, ...]
    """What does not fit the manifest."""
    differences: tuple[str, ...]
    """What comes out otherwise when made again, and by how much."""
    notes: tuple[str, ...] = ()
    uncompared: Mapping[str, str] = field(default_factory=dict)
    """Files that could not be compared, with the reason; ``equal`` does not cover them."""

    @property
    def equal(self) -> bool:
        """Whether everything that can be compared is equal."""
        return not self.altered and not self.differences


def verify_bundle(path: Path, *, drawings: bool = True) -> Verification:
    """Verify a bundle, the zip or a folder it was unpacked to.

    To make the ``drawings``, figures and reports, again too takes most of the time.

    Raises
    ------
    FileError
        It is refused, or not a bundle at all.
    """
    try:
        files = read_folder(path) if path.is_dir() else read_bundle(path)
        altered = check_manifest(files)
    except BundleError as error:
        raise FileError(f"{plain(path)}: {error}", "ask for the submission again") from error
    return verify_files(files, altered, drawings=drawings)


def verify_files(files: Mapping[str, bytes], altered: tuple[str, ...] = (), *, drawings: bool = True) -> Verification:
    """Verify the files of a submission, the manifest included; ``altered`` is what comparing them with it found."""
    digest = hashlib.sha256(files[MANIFEST]).hexdigest()
    try:
        claimed = parse_submission(files.get("submission.json", b""))
        sources = sources_in(files)
    except ValueError as error:
        return Verification(digest, len(files), 0, altered, (plain(error, 400),))
    others = other_versions(claimed.made_with)
    notes: tuple[str, ...] = (f"made with other versions: {plain(', '.join(others.values()), 400)}",) if others else ()
    differences = []
    if claimed.score_version != SCORE_VERSION:
        differences.append(f"score version {plain(claimed.score_version)}, this program computes {SCORE_VERSION}")
    comparison = _Comparison(files, set(others), drawings=drawings)
    try:
        built = build_submission(
            list(sources.values()), title=claimed.title, versions=claimed.made_with, drawings=drawings
        )
        differences += comparison.differences(built.files)
    except HostError as error:
        differences.append(f"the recordings cannot be scored again: {plain(error, 400)}")
    notes += tuple(comparison.notes)
    return Verification(digest, len(files), len(sources), altered, tuple(differences), notes, comparison.uncompared)


class _Comparison:
    """Compares the files of a bundle with those made again."""

    def __init__(self, files: Mapping[str, bytes], others: set[str], *, drawings: bool) -> None:
        self.uncompared: dict[str, str] = {}
        """Reason by name."""
        self.notes: list[str] = []
        self._files = files
        self._others = others
        self._drawings = drawings
        self._rounded = False  # whether a number differs in its last digits

    def differences(self, made: Mapping[str, bytes]) -> list[str]:
        """Compare everything, in the order of the names; numbers first, as what is drawn follows from them."""
        found: list[str] = []
        for name in sorted((set(self._files) | set(made)) - {MANIFEST}, key=lambda name: (_by_bytes(name), name)):
            if name not in self._files:
                found.append(f"{name} is missing")
            elif self._files[name] != made.get(name):
                found += self._content(name, made.get(name))
        return found

    def _content(self, name: str, made: bytes | None) -> list[str]:
        reason = self._reason(name) if _by_bytes(name) else ""
        if reason:
            self.uncompared[name] = reason
            return []
        if made is None:
            return [f"{plain(name)} does not belong to this submission"]
        if _by_bytes(name):
            return [f"{name} is not what the data give"]
        older = _without_counters(self._files[name], made) if name.endswith("/result.json") else None
        if older is not None:
            self.notes.append(f"{plain(name)} has no counters of the link's decoder, as results of older versions")
        found = content_differences(name, self._files[name], made if older is None else older)
        self._rounded |= not found
        return [f"{name}: {what}" for what in found]

    def _reason(self, name: str) -> str:
        """Return why the bytes of a file prove nothing; empty where they do."""
        if is_drawn(name) and not self._drawings:
            return "left out on request"
        if name.endswith(PARQUET) and "pyarrow" not in made_with():
            return "needs pyarrow: pip install 'rotdrift[parquet]'"
        others = sorted(other for other in self._others if decides(other, name))
        if others:
            return f"made with another {plain(', '.join(others))}"
        if self._rounded:
            return "the numbers differ in their last digits, as between processors: so do drawings of them"
        return ""


def _without_counters(claimed: bytes, made: bytes) -> bytes | None:
    """Return a result made again without the link's counters where the claimed one has none of them; else None.

    Results got these keys without another score version, so a submission from before lacks all of them and is still
    right. One that lacks only some was altered.
    """
    try:
        older, result = parse_result(claimed).link, parse_result(made)
    except ValueError:
        return None  # what cannot be read is found as a difference
    if older is None or result.link is None or older != older.without_counters():
        return None
    return result_text(structs.replace(result, link=result.link.without_counters())).encode()


def _by_bytes(name: str) -> bool:
    """Return whether a file can only be compared byte by byte."""
    return is_drawn(name) or name.endswith(PARQUET)
