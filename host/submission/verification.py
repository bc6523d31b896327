"""Verifying a submission: archive, hashes, layout, and every file made again from the raw bytes.

A bundle holds its sources, and the same sources give the same bytes under the same versions. So every other file is
made again: tables and JSON are compared number by number, drawings, reports and parquet byte by byte. Where their bytes
differ and other versions made them, nothing is known, and the file is named as not compared.
Whoever alters a number, a file or a hash is found, unless all sources and everything that follows from them were
altered together: then it is another submission, whose digest differs. Who made it, only a signature shows
(:mod:`host.submission.signing_keys`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from host.errors import FileError, HostError, UsageError
from host.submission.archive import BundleError, archive_bytes, read_archive
from host.submission.bundle import MANIFEST, archive_at, check_manifest, read_folder
from host.submission.contents import build_submission
from host.submission.differences import content_differences
from host.submission.made_with import PACKING, PARQUET, PROGRAM, decides, is_drawn, made_with, other_versions
from host.submission.manifest import SCORE_VERSION, Submission, parse_submission
from host.submission.signature import SignatureFinding, find_signature
from host.submission.source import sources_in
from host.text import plain

if TYPE_CHECKING:
    from minisign import PublicKey

LAST_DIGITS = "the numbers differ in their last digits, as between processors: so do drawings of them"
LEFT_OUT = "left out on request"


@dataclass(frozen=True)
class Verification:
    """What verifying found."""

    digest: str
    """SHA-256 of the manifest: names the whole submission."""
    n_files: int
    n_trials: int
    altered: tuple[str, ...]
    """What does not fit the manifest, or an archive that is not what its files give."""
    differences: tuple[str, ...]
    """What comes out otherwise when made again, and by how much."""
    notes: tuple[str, ...] = ()
    uncompared: Mapping[str, str] = field(default_factory=dict)
    """Files that could not be compared, with the reason; ``equal`` does not cover them."""
    rounded: tuple[str, ...] = ()
    """Files whose numbers are equal, but not to the last digit."""
    drawings: bool = True
    """Whether figures and reports were made again."""
    packing: str = ""
    """Why it is not known whether the archive is packed as its files give; empty where it is."""
    submission: Submission | None = None
    """What was verified, where it can be read."""
    signature: SignatureFinding | None = None
    """Who made it; None where only files were verified."""

    @property
    def equal(self) -> bool:
        """Whether everything that can be compared is equal."""
        return not self.altered and not self.differences

    @property
    def complete(self) -> bool:
        """Whether every byte was compared, so that ``equal`` covers all of it."""
        return self.drawings and not (self.uncompared or self.rounded or self.packing)


def verify_bundle(path: Path, *, drawings: bool = True, key: PublicKey | None = None) -> Verification:
    """Verify a bundle, the zip or a folder it was unpacked to.

    To make the ``drawings``, figures and reports, again too needs most of the time. With a ``key`` the signature beside
    the zip is checked.

    Raises
    ------
    UsageError
        A key for a folder: a signature is that of an archive.
    FileError
        It is refused, or not a bundle at all.
    """
    if path.is_dir() and key is not None:
        raise UsageError(f"{plain(path)} is a folder, and the archive is what is signed", "give the zip")
    try:
        data = None if path.is_dir() else archive_at(path)
        files = read_folder(path) if data is None else read_archive(data)
        altered = check_manifest(files)
    except BundleError as error:
        raise FileError(f"{plain(path)}: {error}", "ask for the submission again") from error
    found = replace(verify_files(files, altered, drawings=drawings), signature=find_signature(path))
    if data is None:
        return found
    if key is not None:
        from host.submission.signing_keys import check_signature  # needs an extra

        found = replace(found, signature=check_signature(data, path, key))
    return found if archive_bytes(files) == data else _packed_otherwise(found)


def _packed_otherwise(found: Verification) -> Verification:
    """Judge an archive of which only the deflated bytes are not as they would be here: zlib decides these."""
    others = set() if found.submission is None else PACKING & set(other_versions(found.submission.made_with))
    if not others:
        return replace(found, altered=(*found.altered, "the archive is packed otherwise than its files give"))
    return replace(found, packing=f"made with another {', '.join(sorted(others))}")


def verify_files(files: Mapping[str, bytes], altered: tuple[str, ...] = (), *, drawings: bool = True) -> Verification:
    """Verify the files of a submission, the manifest included; ``altered`` is what comparing them with it found."""
    digest = hashlib.sha256(files[MANIFEST]).hexdigest()
    try:
        claimed = parse_submission(files.get("submission.json", b""))
        sources = sources_in(files)
    except ValueError as error:
        return Verification(digest, len(files), 0, altered, (plain(error, 400),), drawings=drawings)
    others = other_versions(claimed.made_with)
    notes: tuple[str, ...] = (f"made with other versions: {plain(', '.join(others.values()), 400)}",) if others else ()
    differences = []
    if claimed.score_version != SCORE_VERSION:
        differences.append(f"score version {plain(claimed.score_version)}, this program computes {SCORE_VERSION}")
    # Whether the tables have to be there is known without pyarrow, too.
    parquet = {f"trials/{trial_id}/samples{PARQUET}" for trial_id in sources if "pyarrow" in claimed.made_with}
    differences += [f"{plain(name)} is missing" for name in sorted(parquet - set(files))]
    comparison = _Comparison(files, set(others), parquet, drawings=drawings)
    try:
        built = build_submission(
            list(sources.values()), title=claimed.title, versions=claimed.made_with, drawings=drawings
        )
        differences += comparison.differences(built.files)
        notes += tuple(plain(sentence, 400) for sentence in built.damage)  # equal, and of a damaged recording
    except HostError as error:
        differences.append(f"the recordings cannot be scored again: {plain(error, 400)}")
    return Verification(
        digest,
        len(files),
        len(sources),
        altered,
        tuple(dict.fromkeys(differences)),
        (*notes, *comparison.notes),
        comparison.uncompared,
        tuple(comparison.rounded),
        drawings,
        submission=claimed,
    )


class _Comparison:
    """Compares the files of a bundle with those made again."""

    def __init__(self, files: Mapping[str, bytes], others: set[str], parquet: set[str], *, drawings: bool) -> None:
        self.uncompared: dict[str, str] = {}
        """Reason by name."""
        self.rounded: list[str] = []
        self.notes: list[str] = []
        self._files = files
        self._others = others
        self._parquet = parquet
        self._drawings = drawings

    def differences(self, made: Mapping[str, bytes]) -> list[str]:
        """Compare everything, in the order of the names; numbers first, as what is drawn follows from them."""
        found: list[str] = []
        for name in sorted((set(self._files) | set(made)) - {MANIFEST}, key=lambda name: (self._by_bytes(name), name)):
            if name not in self._files:
                found.append(f"{plain(name)} is missing")
            elif self._files[name] != made.get(name):
                found += self._content(name, made.get(name))
        return found

    def _content(self, name: str, made: bytes | None) -> list[str]:
        shown = plain(name)
        by_bytes = self._by_bytes(name)
        if by_bytes and (reason := self._reason(name)):
            self.uncompared[name] = reason
            return []
        if made is None:
            return [f"{shown} does not belong to this submission"]
        if by_bytes:
            return [f"{shown} is not what the data give"]
        found = content_differences(name, self._files[name], made)
        if not found:
            self.rounded.append(name)
        elif self._others & PROGRAM and all(difference.of_program for difference in found):
            # Its numbers were compared and are equal; only its words cannot be.
            self.uncompared[name] = f"made with another {self._named(PROGRAM)}: numbers equal, words or keys are not"
            self.notes.append(f"{shown}: {'; '.join(difference.text for difference in found)}")
            return []
        return [f"{shown}: {difference.text}" for difference in found]

    def _reason(self, name: str) -> str:
        """Return why the bytes of a file prove nothing; empty where they do."""
        if is_drawn(name) and not self._drawings:
            return LEFT_OUT
        if name in self._parquet and "pyarrow" not in made_with():
            return "needs pyarrow: pip install 'rotdrift[parquet]'"
        others = {other for other in self._others if decides(other, name)}
        if others:
            return f"made with another {self._named(others)}"
        return LAST_DIGITS if self.rounded else ""

    def _named(self, libraries: set[str]) -> str:
        return plain(", ".join(sorted(self._others & libraries)))

    def _by_bytes(self, name: str) -> bool:
        """Return whether a file can only be compared byte by byte."""
        return is_drawn(name) or name in self._parquet
