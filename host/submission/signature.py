"""What is known of a submission's signature: whether there is one, and whether it is of the key given.

The signature is a file beside the archive, ``submission.zip.minisig``, in minisign's format. Making and checking one
needs an extra, and is in :mod:`host.submission.signing_keys`; this module needs nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from host.errors import UsageError
from host.text import plain

SUFFIX = ".minisig"


class Standing(StrEnum):
    """What is known of a submission's signature."""

    NONE = "none"
    """There is none, and none was asked for."""
    UNCHECKED = "unchecked"
    """There is one, but no key to check it with."""
    GOOD = "good"
    """It is of the key that was given, and of exactly this archive."""
    BAD = "bad"
    """A key was given, and there is no such signature."""


@dataclass(frozen=True)
class SignatureFinding:
    """What checking the signature found."""

    standing: Standing
    sentence: str
    """For a person."""
    key_id: str = ""
    """Of the key that signed, as minisign writes it; empty unless the signature is good."""
    comment: str = ""
    """What the signer signed beside the archive; empty unless the signature is good."""


def signature_path(archive: Path) -> Path:
    """Return where the signature of an archive is, as for minisign."""
    return archive.with_name(archive.name + SUFFIX)


def find_signature(archive: Path) -> SignatureFinding:
    """Return what is known without a key: whether there is something to check."""
    beside = signature_path(archive)
    if archive.is_dir() or not beside.is_file():
        return SignatureFinding(Standing.NONE, "not signed: who made it is not known")
    return SignatureFinding(
        Standing.UNCHECKED, f"signature not checked: give the maker's public key with --key ({plain(beside.name)})"
    )


def require_extra() -> None:
    """Refuse to go on without the extra; raises UsageError."""
    try:
        version("py-minisign")  # another distribution has a module of the same name
    except PackageNotFoundError as error:
        raise UsageError("signatures need py-minisign", "pip install 'rotdrift[sign]'") from error
