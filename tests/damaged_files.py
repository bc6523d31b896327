"""A recording of a trial, and every kind of damage to an MCAP file, for tests: functions of its bytes,
its records and a place, and a strategy of all.

Places are shares of the file or of its records, 0 to 1.
"""

import random
import struct

import numpy as np
from hypothesis import strategies as st
from mcap.opcode import Opcode

from host.links.transport import Chunk
from host.recording import format as fmt
from host.recording.writer import RecordingWriter
from tests.recorded_trials import MONOTONIC_NS, WALL_NS, scenario, virtual_chunks

HEAD = struct.Struct("<BQ")
RECORD = st.floats(0, 1, exclude_max=True)
PLACE = st.floats(0, 1)


def write_trial(path):
    """Write a recording of a trial with commands, notes, a view and a window; return its bytes."""
    chunks, _ = virtual_chunks(scenario("ideal", motion={"cycles": 5, "period_s": 1.0}), chunk_s=0.02)
    chunks = list(_within_frames(chunks))
    writer = RecordingWriter(path, "serial:/dev/x", WALL_NS, MONOTONIC_NS, {"cycles": 5})
    for number, chunk in enumerate(chunks):
        writer.add_received(chunk)
        if number % 3 == 0:
            writer.add_orientations(np.array([chunk.host_time_ns]), np.array([[1.0, 0, 0, 0]]), chunk.host_time_ns)
        if number % 40 == 0:
            writer.add_sent(b"\0command\0", chunk.host_time_ns)
            writer.add_note("warning", f"note {number}", chunk.host_time_ns)
    writer.add_values(fmt.ACTION, {"kind": "window-start", "time_s": 2.0}, chunks[-1].host_time_ns)
    writer.close()
    return path.read_bytes()


def _within_frames(chunks):
    """The same bytes, most reads ending in the middle of a frame, as a busy host reads them."""
    moved, rng = b"", random.Random(4)
    for number, chunk in enumerate(chunks):
        data = moved + chunk.data
        moved = data[len(data) - rng.randrange(20) :] if number < len(chunks) - 1 else b""
        yield Chunk(data[: len(data) - len(moved)], chunk.host_time_ns)


def records_of(data):
    """Start and end of each record, by walking the file record by record."""
    found, at = [], 8
    while at < len(data) - 8:
        end = at + HEAD.size + HEAD.unpack_from(data, at)[1]
        found.append((at, end))
        at = end
    return found


def place(data, share):
    return min(int(share * len(data)), len(data) - 1)


def flip(data, records, share, bits):
    hurt = bytearray(data)
    hurt[place(data, share)] ^= bits
    return bytes(hurt)


def hole(data, records, share, length):
    at = place(data, share)
    n = min(length, len(data) - at)
    return data[:at] + bytes(n) + data[at + n :]


def cut(data, records, share):
    return data[: place(data, share)]


def taken_out(data, records, share, length):
    at = place(data, share)
    return data[:at] + data[at + length :]


def repeated(data, records, share, length):
    at = place(data, share)
    return data[: at + length] + data[at:]


def of_record(change):
    def damage(data, records, share, *more):
        start, end = records[int(share * len(records))]
        return data[:start] + change(data[start:end], *more) + data[end:]

    damage.__name__ = change.__name__
    return damage


@of_record
def another_opcode(record, kind):
    return bytes([kind]) + record[1:]


@of_record
def another_channel(record, channel):
    return record[:9] + struct.pack("<H", channel) + record[11:]


@of_record
def another_number(record, number):
    return record[:11] + struct.pack("<I", number) + record[15:]


@of_record
def removed(record):
    return b""


@of_record
def twice(record):
    return record * 2


@of_record
def an_end_in_front(record, kind):
    ending = {Opcode.DATA_END: 4, Opcode.FOOTER: 20}[kind]
    return HEAD.pack(kind, ending) + bytes(ending) + record


def swapped(data, records, share):
    index = min(int(share * len(records)), len(records) - 2)
    (start, middle), (_, end) = records[index : index + 2]
    return data[:start] + data[middle:end] + data[start:middle] + data[end:]


DAMAGE = st.one_of(
    st.tuples(st.just(flip), PLACE, st.integers(1, 255)),
    st.tuples(st.just(hole), PLACE, st.sampled_from([1, 9, 60, 512, 4096, 50_000])),
    st.tuples(st.just(cut), PLACE),
    st.tuples(st.just(taken_out), PLACE, st.sampled_from([1, 9, 60, 512, 4096, 50_000])),
    st.tuples(st.just(repeated), PLACE, st.sampled_from([1, 9, 60, 512, 4096, 50_000])),
    st.tuples(st.just(another_opcode), RECORD, st.one_of(st.integers(0, 15), st.integers(16, 255))),
    st.tuples(st.just(another_channel), RECORD, st.integers(0, 12)),
    st.tuples(st.just(another_number), RECORD, st.sampled_from([0, 1, 50, 2**20, 2**32 - 1])),
    st.tuples(st.just(removed), RECORD),
    st.tuples(st.just(twice), RECORD),
    st.tuples(st.just(an_end_in_front), RECORD, st.sampled_from([Opcode.DATA_END, Opcode.FOOTER])),
    st.tuples(st.just(swapped), RECORD),
)
