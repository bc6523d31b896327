"""The archive: the same bytes for the same content, only these bytes are read, hostile archives are refused."""

import hashlib
import io
import struct
import subprocess
import zipfile
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.submission import archive
from host.submission.archive import BundleError, archive_bytes, read_archive
from host.submission.bundle import MANIFEST, bundle_bytes, check_manifest, manifest_text, read_bundle
from tests.waiting import HANG_S

FILES = {"submission.json": b"{}\n", "trials/a/steps.csv": b"1,2\n" * 50, "trials/a/raw/x.mcap": bytes(range(256)) * 9}


def zip_of(entries, method=zipfile.ZIP_DEFLATED, **attributes):
    """A zip as Python's zipfile writes it, with the same headers as ours unless ``attributes`` alters them."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        for name, content in entries:
            entry = zipfile.ZipInfo(name)
            entry.external_attr, entry.create_system = 0o100644 << 16, 3
            for key, value in attributes.items():
                setattr(entry, key, value)
            entry.compress_type = method
            file.writestr(entry, content, compresslevel=6)
    return buffer.getvalue()


def test_the_same_content_gives_the_same_bytes_in_any_order():
    assert bundle_bytes(FILES) == bundle_bytes(dict(reversed(FILES.items())))


def test_python_s_own_writer_gives_the_same_bytes():
    """An independent writer, and the one that older versions used."""
    assert archive_bytes(FILES) == zip_of(sorted(FILES.items()))


def test_what_was_written_is_read_back_and_checks(tmp_path):
    path = tmp_path / "a.zip"
    path.write_bytes(bundle_bytes(FILES))
    files = read_bundle(path)
    assert {name: files[name] for name in FILES} == FILES
    assert set(files) == {*FILES, MANIFEST}
    assert check_manifest(files) == ()


def test_info_zip_finds_nothing_wrong(tmp_path):
    """A reader that warns of every byte it does not expect."""
    (tmp_path / "a.zip").write_bytes(bundle_bytes(FILES))
    try:
        done = subprocess.run(
            ["unzip", "-t", "a.zip"], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=HANG_S
        )
    except FileNotFoundError:
        pytest.skip("unzip is not installed")
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    assert "No errors detected" in done.stdout


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
    assert check_manifest(files) == (f"{name} is not what {MANIFEST} lists: it was altered",)


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
        "θ",
        "e\u0301",
    ],
)
def test_names_that_may_mean_another_place_or_name_are_refused(name):
    with pytest.raises(BundleError, match="refused: a file named"):
        read_archive(zip_of([(name, b"x")]))
    if not name.endswith("/"):
        with pytest.raises(BundleError, match="refused"):
            bundle_bytes({name: b""})


def test_links_twins_and_crowds_are_refused(monkeypatch):
    with pytest.raises(BundleError, match="contradicts"):
        read_archive(zip_of([("link", b"/etc/passwd")], external_attr=0o120777 << 16))
    with pytest.raises(BundleError, match="a is there twice, but for its case"):
        read_archive(zip_of([("A", b"1"), ("a", b"2")]))
    with pytest.warns(UserWarning, match="Duplicate"):
        twice = zip_of([("a", b"1"), ("a", b"2")])
    with pytest.raises(BundleError, match=r"a is there twice$"):
        read_archive(twice)
    with pytest.raises(BundleError, match="a stands behind b"):
        read_archive(zip_of([("b", b""), ("a", b"")]))
    monkeypatch.setattr(archive, "MAX_ENTRIES", 5)
    with pytest.raises(BundleError, match="more than 5"):
        read_archive(zip_of([(str(k), b"") for k in range(6)]))


def test_an_encrypted_entry_is_refused():
    data = bytearray(zip_of([("secret", b"x" * 50)]))
    for signature, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(signature) + offset] |= 1  # general purpose flag, bit 0
    with pytest.raises(BundleError, match="secret is encrypted"):
        read_archive(bytes(data))


def test_bombs_are_refused_before_they_are_unpacked(monkeypatch):
    bomb = zip_of([("zeros", bytes(40 * 2**20))])
    assert len(bomb) < 100_000
    with monkeypatch.context() as patch:
        patch.setattr(zlib, "decompressobj", None)
        with pytest.raises(BundleError, match="times its size"):
            read_archive(bomb)
    many = zip_of([(f"z{k:02d}", bytes(2**20)) for k in range(20)])
    monkeypatch.setattr(archive, "MAX_TOTAL_BYTES", 10 * 2**20)
    with pytest.raises(BundleError, match="in all"):
        read_archive(many)
    with pytest.raises(BundleError, match="an archive of"):
        read_archive(many + bytes(10 * 2**20))
    with pytest.raises(BundleError, match="in all"):
        archive_bytes({f"z{k:02d}": bytes(2**20) for k in range(20)})  # nor is one written that nobody reads


@pytest.mark.parametrize("claim", [100, 2**20 - 1, 2**20 + 1])
def test_a_false_size_is_noticed_while_unpacking(claim):
    honest = zip_of([("zeros", bytes(2**20))])
    with pytest.raises(BundleError, match="zeros does not unpack to what it claims"):
        read_archive(honest.replace(struct.pack("<I", 2**20), struct.pack("<I", claim)))


def test_what_is_unpacked_never_exceeds_the_claim(monkeypatch):
    """A header that claims 100 bytes gets room for 101, whatever its stream holds."""
    lying = zip_of([("zeros", bytes(2**20))]).replace(struct.pack("<I", 2**20), struct.pack("<I", 100))
    asked, make = [], zlib.decompressobj

    class Inflater:
        def __init__(self, *settings):
            self.inner = make(*settings)

        def __getattr__(self, name):
            return getattr(self.inner, name)

        def decompress(self, data, most):
            asked.append(most)
            return self.inner.decompress(data, most)

    monkeypatch.setattr(zlib, "decompressobj", Inflater)
    with pytest.raises(BundleError):
        read_archive(lying)
    assert asked == [101]


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


def with_comment_of_a_file(data):
    """Give the last file a comment in the directory."""
    end = data.rindex(b"PK\5\6")
    changed = bytearray(data[:end] + b"words" + data[end:])
    struct.pack_into("<H", changed, data.rindex(b"PK\1\2") + 32, 5)
    struct.pack_into("<I", changed, end + 5 + 12, struct.unpack_from("<I", changed, end + 5 + 12)[0] + 5)
    return bytes(changed)


def moved(data, at, hidden):
    """Put bytes at a place among the files or behind them, and correct every offset behind."""
    changed = bytearray(data[:at] + hidden + data[at:])
    place = changed.find(b"PK\1\2", at)
    while place >= 0:
        (offset,) = struct.unpack_from("<I", changed, place + 42)
        struct.pack_into("<I", changed, place + 42, offset + len(hidden) * (offset >= at))
        place = changed.find(b"PK\1\2", place + 1)
    end = changed.rindex(b"PK\5\6")
    struct.pack_into("<I", changed, end + 16, struct.unpack_from("<I", changed, end + 16)[0] + len(hidden))
    return bytes(changed)


def between(data):
    return moved(data, data.index(b"PK\3\4", 4), b"hidden")


def before_the_directory(data):
    return moved(data, data.index(b"PK\1\2"), b"hidden")


def a_file_that_is_not_in_the_directory(data):
    other = zip_of([("zz", b"hidden")])
    return moved(data, data.index(b"PK\1\2"), other[: other.index(b"PK\1\2")])


def two_ends(data):
    """Let readers that search from the front find another directory than those that search from the back."""
    tail = bytearray(data[data.index(b"PK\1\2") :])
    struct.pack_into("<I", tail, len(tail) - 6, len(data))
    return data + bytes(tail)


def zip64(data):
    """Put a 64-bit end, and its locator, before the end."""
    end = data.rindex(b"PK\5\6")
    count, size, offset = struct.unpack_from("<HII", data, end + 10)
    big = struct.pack("<4sQHHIIQQQQ", b"PK\6\6", 44, 45, 45, 0, 0, count, count, size, offset)
    return data[:end] + big + struct.pack("<4sIQI", b"PK\6\7", 0, end, 1) + data[end:]


def behind_the_deflated(_):
    """Pack a file with bytes behind the end of its deflate stream, counted as packed."""
    packed = zlib.compress(b"1,2\n", wbits=-15) + b"hidden"
    header = struct.pack("<5HIIIHH", 20, 0, 8, 0, 33, zlib.crc32(b"1,2\n"), len(packed), 4, 1, 0)
    start = b"PK\3\4" + header + b"a" + packed
    directory = b"PK\1\2" + bytes((20, 3)) + header + struct.pack("<3H2I", 0, 0, 0, 0o100644 << 16, 0) + b"a"
    return start + directory + b"PK\5\6" + struct.pack("<4HIIH", 0, 0, 1, 1, len(directory), len(start), 0)


@pytest.mark.parametrize(
    "hide",
    [
        lambda data: b"#!/bin/sh\n" + data,
        lambda data: data + b"\0",
        commented,
        lambda data: with_extra_field(data, b"PK\3\4", 28, 30),
        lambda data: with_extra_field(data, b"PK\1\2", 30, 46),
        with_comment_of_a_file,
        between,
        before_the_directory,
        a_file_that_is_not_in_the_directory,
        two_ends,
        zip64,
        behind_the_deflated,
    ],
    ids=[
        "in front", "behind", "comment", "field of a file", "field in the directory", "comment of a file", "between",
        "before the directory", "file left out", "two ends", "zip64", "in a file",
    ],
)  # fmt: skip
def test_bytes_that_belong_to_no_file_are_refused(hide):
    data = hide(bundle_bytes(FILES))
    with zipfile.ZipFile(io.BytesIO(data)) as file:
        assert file.testzip() is None, "Python reads it: so might everybody"
    with pytest.raises(BundleError, match="refused"):
        read_archive(data)


LOCAL_FIELDS = {"version": (4, 2), "flags": (6, 2), "method": (8, 2), "time": (10, 2), "date": (12, 2), "CRC": (14, 4)}
DIRECTORY_FIELDS = {
    "writer": (4, 1), "system": (5, 1), "version": (6, 2), "flags": (8, 2), "method": (10, 2), "time": (12, 2),
    "date": (14, 2), "CRC": (16, 4), "packed": (20, 4), "size": (24, 4), "name": (46, 1), "disk": (34, 2),
    "internal": (36, 2), "attributes": (38, 4), "offset": (42, 4),
}  # fmt: skip


@pytest.mark.parametrize(
    ("signature", "place", "size"),
    [
        *((b"PK\3\4", *field) for field in LOCAL_FIELDS.values()),
        *((b"PK\1\2", *field) for field in DIRECTORY_FIELDS.values()),
    ],
    ids=[*(f"of a file: {name}" for name in LOCAL_FIELDS), *(f"in the directory: {name}" for name in DIRECTORY_FIELDS)],
)
def test_every_field_of_every_header_is_what_the_files_give(signature, place, size):
    """A local header and the directory that contradict each other show two readers two archives."""
    data = bytearray(bundle_bytes(FILES))
    start = data.index(signature)
    for bit in range(8 * size):
        data[start + place + bit // 8] ^= 1 << bit % 8
        with pytest.raises(BundleError, match="refused"):
            read_archive(bytes(data))
        data[start + place + bit // 8] ^= 1 << bit % 8
    assert read_archive(bytes(data)).keys() == {*FILES, MANIFEST}


@pytest.mark.parametrize("kind", ["STORED", "BZIP2", "LZMA"])
def test_only_deflated_files_are_read(kind):
    with pytest.raises(BundleError, match="refused: a is not deflated"):
        read_archive(zip_of([("a", b"content" * 9)], getattr(zipfile, f"ZIP_{kind}")))


def test_another_packing_of_the_same_content_is_read_and_known():
    """Another zlib packs otherwise: the content is the same, and the bytes are not those of here."""
    deflater = zlib.compressobj(1, zlib.DEFLATED, -15, strategy=zlib.Z_HUFFMAN_ONLY)
    packed = deflater.compress(FILES["trials/a/steps.csv"]) + deflater.flush()
    content = FILES["trials/a/steps.csv"]
    member = archive._Member("a", zlib.crc32(content), len(packed), len(content))
    header = member.local_header()
    tail = archive._tail({0: member}, len(header) + len(packed))
    assert read_archive(header + packed + tail) == {"a": content}
    assert archive_bytes({"a": content}) != header + packed + tail


@pytest.mark.parametrize("data", [b"", b"PK", b"not a zip at all", bundle_bytes(FILES)[:-30], bundle_bytes(FILES)[60:]])
def test_what_is_not_a_zip_is_refused(tmp_path, data):
    (tmp_path / "a.zip").write_bytes(data)
    with pytest.raises(BundleError):
        read_bundle(tmp_path / "a.zip")
    with pytest.raises(BundleError, match="no file"):
        read_bundle(tmp_path / "none.zip")
    with pytest.raises(BundleError, match="not a file"):
        read_bundle(tmp_path)


@given(st.integers(0, len(bundle_bytes(FILES)) - 1), st.integers(1, 255))
def test_a_byte_altered_anywhere_is_refused_or_found(place, change):
    data = bytearray(bundle_bytes(FILES))
    data[place] ^= change
    try:
        files = read_archive(bytes(data))
    except BundleError:
        return
    # Only the packing may differ, which is compared with what the files give.
    assert files.keys() == {*FILES, MANIFEST}
    assert check_manifest(files) != () or archive_bytes(files) != bytes(data)


@pytest.mark.parametrize("cut", [0, 1, 29, 30, 31, 200])
def test_an_archive_that_ends_early_is_refused(cut):
    for start in (0, bundle_bytes(FILES).index(b"PK\3\4", 4), bundle_bytes(FILES).index(b"PK\1\2")):
        with pytest.raises(BundleError):
            read_archive(bundle_bytes(FILES)[: start + cut])
