"""What a file is, for ``rotdrift check``: a recording, an archive with recordings, or neither."""

from __future__ import annotations

import tempfile
from pathlib import Path

from analysis.formats import SourceFile, is_mcap
from analysis.formats.parquet import MAGIC as PARQUET_MAGIC
from host.errors import FileError, UsageError, unreadable
from host.links.can.log_kind import can_log_kind
from host.recording.check.account import CheckReport
from host.recording.check.mcap_file import check_mcap
from host.recording.elsewhere.raw_bytes import is_raw_wire
from host.submission.archive import BundleError
from host.submission.bundle import MANIFEST, check_manifest, read_bundle, read_folder
from host.text import plain

_ZIP, _ROS1, _SQLITE = b"PK\x03\x04", b"#ROSBAG V", b"SQLite format 3\0"


def check_file(path: Path) -> dict[str, CheckReport]:
    """Check a recording, any MCAP file, or every recording of a submission.

    Returns
    -------
    dict
        Report by name; of a submission by the name in the archive.

    Raises
    ------
    UsageError
        It is something else; the message names it.
    FileError
        It cannot be read, or a submission is refused.
    """
    try:
        with SourceFile(path) as source:
            head = source.head
    except OSError as error:
        raise unreadable(path, error) from error
    if is_mcap(head):
        return {path.name: check_mcap(path)}
    if head.startswith(_ZIP) or (path / MANIFEST).is_file():
        return _check_archive(path)
    if not head and not path.is_dir():
        raise FileError(f"{path} is empty", "give a recording")
    what, remedy = _other(path, head)
    raise UsageError(f"{plain(path, 200)} is not a recording: {what}", remedy)


def _check_archive(path: Path) -> dict[str, CheckReport]:
    try:
        files = read_folder(path) if path.is_dir() else read_bundle(path)
        altered = check_manifest(files)
    except BundleError as error:
        raise FileError(f"{plain(path, 200)}: {error}", "ask for the submission again") from error
    if altered:
        raise FileError(f"{plain(path, 200)}: {altered[0]}", "`rotdrift verify` reports everything altered in it")
    found = {}
    with tempfile.TemporaryDirectory(prefix="rotdrift-") as folder:
        for name, content in sorted(files.items()):
            if "/raw/" in name and is_mcap(content[:64]):
                place = Path(folder) / "recording.mcap"
                place.write_bytes(content)
                found[name] = check_mcap(place, now_s=lambda: 0.0)  # nobody writes to it
    if not found:
        raise UsageError(f"{plain(path, 200)} holds no recording to check", "`rotdrift verify` checks its numbers")
    return found


def _other(path: Path, head: bytes) -> tuple[str, str]:
    """Return what a file is that is not MCAP, and what to do with it."""
    score = "`rotdrift score` reads it"
    if path.is_dir():
        if (path / "metadata.yaml").is_file():
            return "a ROS 2 bag", f"check the .mcap files in it; {score}"
        return "a folder", "give a file in it"
    if head.startswith(_ROS1):
        return "a ROS 1 bag", score
    if head.startswith(_SQLITE):
        return "a ROS 2 bag's .db3 file", "`rotdrift score` reads the folder that it is in"
    if head.startswith(PARQUET_MAGIC):
        return "a parquet file", score
    log = can_log_kind(head)
    if log is not None:
        return f"a CAN log ({log})", score
    if is_raw_wire(head):
        return "bytes of a link without times of arrival", score
    if b"\0" in head:
        return "a binary file of no kind known here", "if it once was a recording, try `rotdrift recover`"
    first = head.decode("utf-8", "replace").lstrip("\ufeff").splitlines()[:1]
    kind = "a CSV" if first and any(mark in first[0] for mark in ",;\t") else "a text file"
    return kind, f"{score} if it is a table of orientations"
