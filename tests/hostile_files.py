"""Files that claim, or unpack to, far more than they are: each is small, and made here in a moment.

``MADE`` has a function for each; it writes into an empty folder and returns the file.
"""

from __future__ import annotations

import bz2
import json
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mcap import records as mcap
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from firmware_protocol.packets import Orientation
from host.links.transport import Chunk
from tests.recorded_trials import MONOTONIC_NS, write_recording
from tests.wire_streams import frame

GIB = 2**30
BOMB = 2 * GIB
"""Twice what the commands may use."""
CENTURY_NS = 3_155_760_000 * 10**9
CSV_HEAD = "t,qw,qx,qy,qz\n"


def zeros_deflated(n_bytes: int, wbits: int) -> bytes:
    """So many zeros, packed: one piece again and again, as packing them all takes long."""
    packer = zlib.compressobj(9, zlib.DEFLATED, wbits)
    first = packer.compress(bytes(2**24)) + packer.flush(zlib.Z_FULL_FLUSH)
    piece = packer.compress(bytes(2**24)) + packer.flush(zlib.Z_FULL_FLUSH)
    return first + piece * (n_bytes // 2**24 - 1) + packer.flush()


def zeros_zstd(n_bytes: int, claim: int) -> bytes:
    """A zstd frame of so many zeros, in blocks of one repeated byte, that claims ``claim``."""
    block = struct.pack("<I", 2**17 << 3 | 1 << 1)[:3] + b"\0"
    last = struct.pack("<I", 2**17 << 3 | 1 << 1 | 1)[:3] + b"\0"
    head = b"\x28\xb5\x2f\xfd" + bytes([0xC0, 0x38]) + struct.pack("<Q", claim)
    return head + block * (n_bytes // 2**17 - 1) + last


def zeros_lz4(n_bytes: int) -> bytes:
    """An lz4 frame of so many zeros."""
    import lz4.frame

    whole = lz4.frame.compress(
        bytes(2**22), block_size=lz4.frame.BLOCKSIZE_MAX4MB, store_size=False, block_linked=False
    )
    head, end = whole[:7], whole[-4:]
    return head + whole[7:-4] * (n_bytes // 2**22) + end


def record(kind: int, body: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(body)) + body


def chunk(claim: int, compression: str, content: bytes) -> bytes:
    name = compression.encode()
    head = struct.pack("<QQQII", 0, 2**62, claim, 0, len(name)) + name + struct.pack("<Q", len(content))
    return record(Opcode.CHUNK, head + content)


# Packed single files and submissions.


def gz(folder: Path) -> Path:
    path = folder / "trial.csv.gz"
    path.write_bytes(zeros_deflated(BOMB, 16 + zlib.MAX_WBITS))
    return path


def zst(folder: Path) -> Path:
    path = folder / "trial.csv.zst"
    path.write_bytes(zeros_zstd(BOMB, BOMB))
    return path


def zst_claim(folder: Path) -> Path:
    path = folder / "trial.mcap.zst"
    path.write_bytes(zeros_zstd(2**17, 2**62))
    return path


def zip_of_zeros(folder: Path) -> Path:
    """A submission whose manifest unpacks to more than memory, and claims less."""
    path = folder / "submission.zip"
    packed = zeros_deflated(BOMB, -zlib.MAX_WBITS)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr("SHA256SUMS", packed)
    data = bytearray(path.read_bytes())
    for at in (8, data.index(b"PK\1\2") + 10):  # the method: deflated
        data[at : at + 2] = struct.pack("<H", zipfile.ZIP_DEFLATED)
    path.write_bytes(bytes(data))
    return path


# MCAP and our own recordings.


def samples(n: int, at_ns: Callable[[int], int], device_us: Callable[[int], int] = lambda k: 5000 * k) -> list[Chunk]:
    """Samples of a swing, one a chunk, each received and taken when the functions say."""
    found = []
    for k in range(n):
        half = 0.25 * np.sin(2 * np.pi * k / 100)
        packet = Orientation(k % 65536, device_us(k) % 2**32, (float(np.cos(half)), float(np.sin(half)), 0.0, 0.0), 0)
        found.append(Chunk(frame(packet), at_ns(k)))
    return found


def host_times_a_century_apart(folder: Path) -> Path:
    """Half of the chunks came a century after the others."""
    chunks = samples(4000, lambda k: MONOTONIC_NS + 5_000_000 * k + (CENTURY_NS if k >= 2000 else 0))
    return write_recording(folder / "trial.mcap", chunks)


def host_times_years_apart(folder: Path) -> Path:
    """Every chunk came a month after the one before."""
    return write_recording(folder / "trial.mcap", samples(2000, lambda k: 1000 + CENTURY_NS // 1200 * k))


def host_times_at_the_end_of_time(folder: Path) -> Path:
    chunks = samples(2000, lambda k: 2**62 - 1 if k >= 1000 else MONOTONIC_NS + 5_000_000 * k)
    return write_recording(folder / "trial.mcap", chunks)


def device_clock_that_wraps_at_every_sample(folder: Path) -> Path:
    """The device's 71 minutes pass between two samples, on both clocks."""
    chunks = samples(800, lambda k: MONOTONIC_NS + k * 4_294_000_000_000, lambda k: k * 4_294_000_000)
    return write_recording(folder / "trial.mcap", chunks)


def _with_chunk(folder: Path, body: bytes) -> Path:
    """A recording of ours with a chunk behind its description."""
    path = write_recording(folder / "trial.mcap", samples(600, lambda k: MONOTONIC_NS + 5_000_000 * k))
    data = path.read_bytes()
    at = len(MCAP0_MAGIC)
    for _ in range(2):  # header, metadata
        at += 9 + struct.unpack_from("<Q", data, at + 1)[0]
    path.write_bytes(data[:at] + body + data[at:])
    return path


def mcap_chunk_claims_4_gib(folder: Path) -> Path:
    return _with_chunk(folder, chunk(4 * GIB, "zstd", zeros_zstd(2**17, 4 * GIB)))


def mcap_chunk_of_zstd(folder: Path) -> Path:
    return _with_chunk(folder, chunk(2**20, "zstd", zeros_zstd(BOMB, BOMB)))


def mcap_chunk_of_lz4(folder: Path) -> Path:
    return _with_chunk(folder, chunk(2**20, "lz4", zeros_lz4(BOMB)))


def ros2_mcap(folder: Path, compression: str, content: bytes, claim: int) -> Path:
    """A foreign MCAP file whose one chunk is that."""
    made = RecordBuilder()
    parts = [
        mcap.Header("ros2", ""),
        mcap.Schema(encoding="ros2msg", data=b"", name="geometry_msgs/msg/QuaternionStamped", id=1),
        mcap.Channel(id=1, topic="/q", message_encoding="cdr", metadata={}, schema_id=1),
    ]
    for part in parts:
        part.write(made)
    head = MCAP0_MAGIC + made.end()
    packed = chunk(claim, compression, content)
    mcap.DataEnd(0).write(made)
    end = made.end()
    for part in parts[1:]:
        part.write(made)
    mcap.ChunkIndex(
        chunk_start_offset=len(head),
        chunk_length=len(packed),
        message_start_time=0,
        message_end_time=2,
        message_index_length=0,
        message_index_offsets={1: 0},
        compression=compression,
        compressed_size=len(content),
        uncompressed_size=claim,
    ).write(made)
    mcap.Statistics(
        attachment_count=0,
        channel_count=1,
        channel_message_counts={1: 10},
        chunk_count=1,
        message_count=10,
        metadata_count=0,
        message_start_time=0,
        message_end_time=2,
        schema_count=1,
    ).write(made)
    start = len(head) + len(packed) + len(end)
    mcap.Footer(summary_start=start, summary_offset_start=0, summary_crc=0).write(made)
    path = folder / "bag.mcap"
    path.write_bytes(head + packed + end + made.end() + MCAP0_MAGIC)
    return path


def ros2_mcap_of_zstd(folder: Path) -> Path:
    return ros2_mcap(folder, "zstd", zeros_zstd(BOMB, BOMB), BOMB)


def ros2_mcap_of_lz4(folder: Path) -> Path:
    return ros2_mcap(folder, "lz4", zeros_lz4(BOMB), BOMB)


# ROS bags.


def _ros1_chunk(folder: Path, compression: str, content: bytes, claim: int) -> Path:
    """A sound ROS 1 bag with its chunk packed otherwise."""
    seed = (Path(__file__).parent / "fuzz" / "seeds" / "bag" / "ros1.bag").read_bytes()
    at = seed.index(b"compression=")
    start = at - 4  # of the field; before it stand other fields of the record's header
    return _rewritten(folder, seed, start, compression, content, claim)


def _rewritten(folder: Path, seed: bytes, start: int, compression: str, content: bytes, claim: int) -> Path:
    from rosbags.rosbag1 import Reader

    with Reader(Path(__file__).parent / "fuzz" / "seeds" / "bag" / "ros1.bag") as reader:
        position = next(iter(reader.chunks))
    header_length = struct.unpack_from("<I", seed, position)[0]
    fields = b""
    for name, value in (
        (b"op", b"\x05"),
        (b"compression", compression.encode()),
        (b"size", struct.pack("<I", claim)),
    ):
        field = name + b"=" + value
        fields += struct.pack("<I", len(field)) + field
    old_data = position + 4 + header_length
    behind = old_data + 4 + struct.unpack_from("<I", seed, old_data)[0]
    made = struct.pack("<I", len(fields)) + fields + struct.pack("<I", len(content)) + content
    grown = len(made) - (behind - position)
    data = bytearray(seed[:position] + made + seed[behind:])
    index = data.index(b"index_pos=") + len(b"index_pos=")
    struct.pack_into("<Q", data, index, struct.unpack_from("<Q", data, index)[0] + grown)
    path = folder / "trial.bag"
    path.write_bytes(bytes(data))
    return path


def ros1_chunk_of_bz2(folder: Path) -> Path:
    return _ros1_chunk(folder, "bz2", bz2.compress(bytes(2**24)) * (BOMB // 2**24), 2**32 - 1)


def ros1_chunk_of_lz4(folder: Path) -> Path:
    return _ros1_chunk(folder, "lz4", zeros_lz4(BOMB), 2**32 - 1)


METADATA = """rosbag2_bagfile_information:
  version: 5
  storage_identifier: sqlite3
  relative_file_paths: [{name}]
  duration: {{nanoseconds: 1}}
  starting_time: {{nanoseconds_since_epoch: 0}}
  message_count: 1
  topics_with_message_count:
    - topic_metadata:
        {{name: /q, type: geometry_msgs/msg/QuaternionStamped, serialization_format: cdr, offered_qos_profiles: ""}}
      message_count: 1
  compression_format: "{compression}"
  compression_mode: "{mode}"
"""


def _ros2_folder(folder: Path, name: str = "q.db3", compression: str = "", mode: str = "") -> Path:
    bag = folder / "bag"
    bag.mkdir()
    (bag / "metadata.yaml").write_text(METADATA.format(name=name, compression=compression, mode=mode))
    return bag


def _database(path: Path, messages: str) -> None:
    with sqlite3.connect(path) as base:
        base.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, "
            "offered_qos_profiles TEXT)"
        )
        base.execute("INSERT INTO topics VALUES (1, '/q', 'geometry_msgs/msg/QuaternionStamped', 'cdr', '')")
        base.execute(messages)
        base.executemany("INSERT INTO messages(id, topic_id, timestamp) VALUES (?, 1, ?)", [(1, 1), (2, 2)])
    base.close()


def ros2_blob_that_is_computed(folder: Path) -> Path:
    bag = _ros2_folder(folder)
    blob = "data BLOB GENERATED ALWAYS AS (zeroblob(999999999)) VIRTUAL"
    _database(
        bag / "q.db3", f"CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, {blob})"
    )
    return bag


def ros2_packed_file(folder: Path) -> Path:
    """A bag that is unpacked to the disk."""
    bag = _ros2_folder(folder, "q.db3.zstd", "zstd", "file")
    (bag / "q.db3.zstd").write_bytes(zeros_zstd(3 * GIB, 3 * GIB))
    return bag


# Tables.


def parquet_of_one_value(folder: Path, n: int = 19_000_000) -> Path:
    import pyarrow as arrow
    from pyarrow import parquet

    path = folder / "trial.parquet"
    row = arrow.DictionaryArray.from_arrays(arrow.array(np.zeros(n, np.int32)), arrow.array([0.5]))
    table = arrow.table(dict.fromkeys(("t", "qw", "qx", "qy", "qz"), row))
    parquet.write_table(table, path, compression="zstd", use_dictionary=True)
    return path


def parquet_that_claims_rows(folder: Path) -> Path:
    """2^31 rows, by its description; a thousand are there."""
    path = parquet_of_one_value(folder, 2**20)
    data = path.read_bytes()
    size = struct.unpack("<I", data[-8:-4])[0]
    footer = data[-8 - size : -8]
    footer = footer.replace(b"\x16" + _varint(2 * 2**20), b"\x16" + _varint(2 * 2**31))  # thrift: i64, zigzag
    path.write_bytes(data[: -8 - size] + footer + struct.pack("<I", len(footer)) + b"PAR1")
    return path


def _varint(value: int) -> bytes:
    out = b""
    while value > 0x7F:
        out += bytes([value & 0x7F | 0x80])
        value >>= 7
    return out + bytes([value])


def _csv(folder: Path, times: list[float], name: str = "trial.csv") -> Path:
    half = 0.25 * np.sin(2 * np.pi * np.arange(len(times)) / 100)
    rows = zip(times, np.cos(half).tolist(), np.sin(half).tolist(), strict=True)
    path = folder / name
    path.write_text(CSV_HEAD + "".join(f"{t!r},{w!r},{x!r},0,0\n" for t, w, x in rows))
    return path


def csv_times_a_century_apart(folder: Path) -> Path:
    return _csv(folder, [0.01 * k + (3e9 if k >= 2000 else 0.0) for k in range(4000)])


def csv_times_of_no_size(folder: Path) -> Path:
    return _csv(folder, [1e300 * k for k in range(2000)])


def csv_times_that_hardly_move(folder: Path) -> Path:
    return _csv(folder, [2.0**52 + k for k in range(2000)])


def csv_counters_of_2_to_the_63(folder: Path) -> Path:
    return _csv(folder, [float(2**63 - 2**20 * (4000 - k)) for k in range(4000)])


def ximu3_time_stamps_of_64_bits(folder: Path) -> Path:
    path = folder / "Quaternion.csv"
    rows = "".join(f"{k * 2**52},1,0,0,0\n" for k in range(2000))
    path.write_text("Timestamp (us),W,X,Y,Z\n" + rows)
    return path


def tum_times_a_century_apart(folder: Path) -> Path:
    path = folder / "trial.tum"
    path.write_text("".join(f"{k * 3.2e6!r} 0 0 0 0 0 0 1\n" for k in range(2000)))
    return path


# CAN logs.


def blf_container(folder: Path) -> Path:
    """A container of a BLF that unpacks to gigabytes."""
    path = folder / "log.blf"
    packed = zeros_deflated(BOMB, zlib.MAX_WBITS)
    container = struct.pack("<H6xI4x", 2, 2**32 - 1) + packed
    body = struct.pack("<4sHHII", b"LOBJ", 16, 1, 16 + len(container), 10) + container
    head = struct.pack(
        "<4sIBBBBBBBBQQIIHHHHHHHHHHHHHHHH",
        b"LOGG",
        144,
        5,
        0,
        0,
        0,
        2,
        6,
        8,
        1,
        144 + len(body),
        2**40,
        2,
        2,
        *([2020, 1, 1, 1, 0, 0, 0, 0] * 2),
    )
    path.write_bytes(head.ljust(144, b"\0") + body)
    return path


def candump_times_a_century_apart(folder: Path) -> Path:
    path = folder / "log.log"
    path.write_text("".join(f"({k * 10**9 + 1}.000000) can0 183#0011223344556677\n" for k in range(2000)))
    return path


# What other commands read.


def nested_json(folder: Path) -> Path:
    path = folder / "result.json"
    path.write_text("[" * 100_000 + "]" * 100_000)
    return path


def json_of_many_lists(folder: Path) -> Path:
    path = folder / "result.json"
    path.write_text(json.dumps({"format": 1, "notes": [[]] * 2_000_000}))
    return path


TRIALS = (
    gz,
    zst,
    zst_claim,
    host_times_a_century_apart,
    host_times_years_apart,
    host_times_at_the_end_of_time,
    device_clock_that_wraps_at_every_sample,
    mcap_chunk_claims_4_gib,
    mcap_chunk_of_zstd,
    mcap_chunk_of_lz4,
    ros2_mcap_of_zstd,
    ros2_mcap_of_lz4,
    ros1_chunk_of_bz2,
    ros1_chunk_of_lz4,
    ros2_blob_that_is_computed,
    parquet_of_one_value,
    parquet_that_claims_rows,
    csv_times_a_century_apart,
    csv_times_of_no_size,
    csv_times_that_hardly_move,
    csv_counters_of_2_to_the_63,
    ximu3_time_stamps_of_64_bits,
    tum_times_a_century_apart,
    blf_container,
    candump_times_a_century_apart,
)
"""What should be a recording."""
