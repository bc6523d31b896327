"""The bundle file: the same bytes for the same content, every alteration found, hostile archives refused."""

import hashlib
import io
import struct
import subprocess
import zipfile
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.submission import bundle
from host.submission.bundle import (
    MANIFEST,
    BundleError,
    bundle_bytes,
    check_manifest,
    manifest_text,
    read_bundle,
)
from tests.waiting import HANG_S

FILES = {"submission.json": b"{}\n", "trials/a/steps.csv": b"1,2\n" * 50, "trials/a/raw/x.mcap": bytes(range(256)) * 9}


def write(path, data):
    path.write_bytes(data)
    return path


def zip_of(entries, path, **extra):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in entries:
            info = zipfile.ZipInfo(name)
            info.external_attr = extra.get("attributes", 0)
            archive.writestr(info, content, zipfile.ZIP_DEFLATED)
    return path


def test_the_same_content_gives_the_same_bytes_in_any_order():
    assert bundle_bytes(FILES) == bundle_bytes(dict(reversed(FILES.items())))


def test_what_was_written_is_read_back_and_checks(tmp_path):
    files = read_bundle(write(tmp_path / "a.zip", bundle_bytes(FILES)))
    assert {name: files[name] for name in FILES} == FILES
    assert set(files) == {*FILES, MANIFEST}
    assert check_manifest(files) == ()


def test_the_manifest_is_understood_by_sha256sum(tmp_path):
    with zipfile.ZipFile(io.BytesIO(bundle_bytes(FILES))) as archive:
        archive.extractall(tmp_path)
    assert f"{hashlib.sha256(b'{}' + bytes([10])).hexdigest()}  submission.json" in manifest_text(FILES)
    try:
        done = subprocess.run(
            ["sha256sum", "-c", MANIFEST], cwd=tmp_path, capture_output=True, check=False, timeout=HANG_S
        )
    except FileNotFoundError:
        pytest.skip("sha256sum is not installed")
    assert done.returncode == 0, done.stderr


@given(st.sampled_from(sorted(FILES)), st.integers(0, 10_000), st.integers(1, 255))
def test_any_altered_byte_is_found(name, place, change):
    files = dict(FILES) | {MANIFEST: manifest_text(FILES).encode()}
    content = bytearray(files[name])
    content[place % len(content)] ^= change
    files[name] = bytes(content)
    assert check_manifest(files) == (f"{name} is not what {MANIFEST} says: it was altered",)


def test_missing_extra_and_false_lines_are_found():
    files = dict(FILES) | {MANIFEST: manifest_text(FILES).encode()}
    without = {name: content for name, content in files.items() if name != "submission.json"}
    assert check_manifest(without) == ("submission.json is missing",)
    assert check_manifest(files | {"more.txt": b""}) == (f"more.txt is not in {MANIFEST}",)
    with pytest.raises(BundleError, match="line 1"):
        check_manifest(files | {MANIFEST: b"nonsense\n"})
    with pytest.raises(BundleError, match="line 4"):
        check_manifest(files | {MANIFEST: files[MANIFEST] + files[MANIFEST].splitlines()[0] + b"\n"})
    with pytest.raises(BundleError, match="no SHA256SUMS"):
        check_manifest(FILES)


@pytest.mark.parametrize(
    "name",
    [
        "../evil",
        "a/../../evil",
        "/etc/passwd",
        "C:evil",
        "a\\..\\evil",
        "a//b",
        "./a",
        "a/\x1b[2J",
        "x" * 300,
        "folder/",
    ],
)
def test_names_that_leave_the_folder_are_refused(tmp_path, name):
    with pytest.raises(BundleError, match="refused"):
        read_bundle(zip_of([(name, b"x")], tmp_path / "a.zip"))
    if not name.endswith("/"):
        with pytest.raises(BundleError, match="refused"):
            bundle_bytes({name: b""})


def test_links_twins_and_crowds_are_refused(tmp_path, monkeypatch):
    with pytest.raises(BundleError, match="link or device"):
        read_bundle(zip_of([("link", b"/etc/passwd")], tmp_path / "a.zip", attributes=0o120777 << 16))
    with pytest.raises(BundleError, match="twice"):
        read_bundle(zip_of([("a", b"1"), ("A", b"2")], tmp_path / "b.zip"))
    monkeypatch.setattr(bundle, "MAX_ENTRIES", 5)
    with pytest.raises(BundleError, match="more than 5"):
        read_bundle(zip_of([(str(k), b"") for k in range(6)], tmp_path / "c.zip"))


def test_an_encrypted_entry_is_refused(tmp_path):
    data = bytearray(zip_of([("secret", b"x" * 50)], tmp_path / "a.zip").read_bytes())
    for signature, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(signature) + offset] |= 1  # general purpose flag, bit 0
    with pytest.raises(BundleError, match="secret is encrypted"):
        read_bundle(write(tmp_path / "b.zip", bytes(data)))


def test_bombs_are_refused_before_they_are_unpacked(tmp_path, monkeypatch):
    bomb = zip_of([("zeros", bytes(40 * 2**20))], tmp_path / "bomb.zip")
    assert bomb.stat().st_size < 100_000
    with pytest.raises(BundleError, match="times its size"):
        read_bundle(bomb)
    many = zip_of([(f"z{k}", bytes(2**20)) for k in range(20)], tmp_path / "many.zip")
    monkeypatch.setattr(bundle, "MAX_TOTAL_BYTES", 10 * 2**20)
    with pytest.raises(BundleError, match="in all"):
        read_bundle(many)


def test_a_lie_about_the_size_is_noticed_while_unpacking(tmp_path):
    honest = zip_of([("zeros", bytes(2**20))], tmp_path / "a.zip").read_bytes()
    lying = honest.replace(struct.pack("<I", 2**20), struct.pack("<I", 100))
    with pytest.raises(BundleError):
        read_bundle(write(tmp_path / "b.zip", lying))


def commented(data):
    return data[:-2] + struct.pack("<H", 5) + b"words"


def with_extra_field(data, signature, length_at, end_at):
    """Give the last header of this kind a well-formed field that no reader knows."""
    place = data.rindex(signature)
    (length,) = struct.unpack_from("<H", data, place + length_at - 2)
    field = struct.pack("<HH", 0xCAFE, 4) + b"hide"
    start = place + end_at + length
    changed = bytearray(data[:start] + field + data[start:])
    struct.pack_into("<H", changed, place + length_at, len(field))
    end = changed.rindex(b"PK\5\6")
    at = 12 if signature == b"PK\1\2" else 16  # the directory is longer, or begins later
    struct.pack_into("<I", changed, end + at, struct.unpack_from("<I", changed, end + at)[0] + len(field))
    return bytes(changed)


def between(data):
    """Put bytes in front of the second file and correct every offset behind."""
    first = data.index(b"PK\3\4", 4)
    changed = bytearray(data[:first] + b"hidden" + data[first:])
    place = changed.index(b"PK\1\2")
    while (place := changed.find(b"PK\1\2", place + 1)) > 0:
        struct.pack_into("<I", changed, place + 42, struct.unpack_from("<I", changed, place + 42)[0] + 6)
    end = changed.rindex(b"PK\5\6")
    struct.pack_into("<I", changed, end + 16, struct.unpack_from("<I", changed, end + 16)[0] + 6)
    return bytes(changed)


def behind_the_deflated(_):
    """Pack a file with bytes behind the end of its deflate stream, counted as packed."""
    packed = zlib.compress(b"1,2\n", wbits=-15) + b"hidden"
    header = struct.pack("<5HIIIHH", 20, 0, 8, 0, 33, zlib.crc32(b"1,2\n"), len(packed), 4, 1, 0)
    start = b"PK\3\4" + header + b"a" + packed
    directory = b"PK\1\2" + struct.pack("<H", 0x0314) + header + bytes(14) + b"a"
    return start + directory + b"PK\5\6" + struct.pack("<4HIIH", 0, 0, 1, 1, len(directory), len(start), 0)


@pytest.mark.parametrize(
    "hide",
    [
        lambda data: b"#!/bin/sh\n" + data,
        lambda data: data + b"\0",
        commented,
        lambda data: with_extra_field(data, b"PK\3\4", 28, 30),
        lambda data: with_extra_field(data, b"PK\1\2", 30, 46),
        between,
        behind_the_deflated,
    ],
    ids=["in front", "behind", "comment", "field of a file", "field in the directory", "between", "in a file"],
)
def test_bytes_that_belong_to_no_file_are_refused(tmp_path, hide):
    path = write(tmp_path / "a.zip", hide(bundle_bytes(FILES)))
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None, "Python reads it: so might everybody"
    with pytest.raises(BundleError, match="refused"):
        read_bundle(path)


@pytest.mark.parametrize(("kind", "fine"), [("STORED", True), ("DEFLATED", True), ("BZIP2", False), ("LZMA", False)])
def test_only_files_stored_or_deflated_are_read(tmp_path, kind, fine):
    path = tmp_path / "a.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(zipfile.ZipInfo("a"), b"content" * 9, getattr(zipfile, f"ZIP_{kind}"))
    if fine:
        assert read_bundle(path) == {"a": b"content" * 9}
    else:
        with pytest.raises(BundleError, match="refused: a is neither stored nor deflated"):
            read_bundle(path)


@pytest.mark.parametrize("data", [b"", b"PK", b"not a zip at all", bundle_bytes(FILES)[:-30], bundle_bytes(FILES)[60:]])
def test_what_is_no_zip_is_said_so(tmp_path, data):
    with pytest.raises(BundleError):
        read_bundle(write(tmp_path / "a.zip", data))
    with pytest.raises(BundleError, match="no file"):
        read_bundle(tmp_path / "none.zip")


@given(st.integers(0, len(bundle_bytes(FILES)) - 1), st.integers(1, 255))
def test_a_damaged_zip_is_refused_or_its_alteration_found(tmp_path_factory, place, change):
    data = bytearray(bundle_bytes(FILES))
    data[place] ^= change
    path = write(tmp_path_factory.mktemp("z") / "a.zip", bytes(data))
    try:
        files = read_bundle(path)
        found = check_manifest(files)
    except BundleError:
        return
    # Bytes that say nothing of the content (time stamps, attributes) may change without harm.
    assert found or {name: files[name] for name in FILES} == FILES
