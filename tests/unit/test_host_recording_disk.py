"""Recordings on a disk that is full, slow, or taken away: kept in memory, written as soon as it can be."""

import errno
import os
import stat
import sys
import tempfile
import threading

import pytest

from host.capture.loop import LOOP_S
from host.recording.reader import RecordingReader
from host.recording.sink import SYNC_NS, RecordingSink
from host.recording.writer import FLUSH_PERIOD_NS
from tests.small_recordings import MONO, chunks, writer
from tests.waiting import HANG_S, wait_for


class Disk:
    """Stands for ``os.write`` on a disk with little room left."""

    def __init__(self, room):
        self.room = room

    def __call__(self, descriptor, data):
        if self.room <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        n = WRITE(descriptor, bytes(data)[: self.room])
        self.room -= n
        return n


WRITE = os.write


def test_a_full_disk_keeps_the_capture_in_memory_and_goes_on_when_there_is_room(tmp_path, monkeypatch):
    path = tmp_path / "trial.mcap"
    sink = writer(path)
    disk = Disk(room=100)
    monkeypatch.setattr(os, "write", disk)
    for chunk in chunks(10):
        sink.add_received(chunk)
    sink.flush_if_due(MONO + 10**9)
    assert "the disk is full" in sink.problem
    assert "kept in memory" in sink.problem
    disk.room = 10**9
    sink.flush_if_due(MONO + 10**9 + 10**8)  # too early to try again
    assert sink.problem
    sink.flush_if_due(MONO + 3 * 10**9)
    assert sink.problem is None
    for chunk in chunks(20)[10:]:
        sink.add_received(chunk)
    sink.close()
    assert list(RecordingReader(path).chunks()) == chunks()


def test_what_the_disk_did_not_take_is_still_read_from_memory_and_saved_elsewhere(tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "elsewhere"))
    path = tmp_path / "trial.mcap"
    sink = writer(path)
    monkeypatch.setattr(os, "write", Disk(room=333))
    for chunk in chunks():
        sink.add_received(chunk)
    said = []
    sink.close(said.append)
    assert "the disk is full" in said[0]
    assert list(RecordingReader(path, continuation=sink.unwritten).chunks()) == chunks()
    (rescued,) = (tmp_path / "elsewhere").iterdir()
    assert str(rescued) in said[0]
    whole = RecordingReader(rescued)
    assert list(whole.chunks()) == chunks()
    assert whole.damage == []
    cut = list(RecordingReader(path).chunks())
    assert cut == chunks()[: len(cut)]
    assert len(cut) < 20


def test_the_memory_for_a_full_disk_is_bounded_and_what_is_lost_is_said(tmp_path, monkeypatch):
    path = tmp_path / "trial.mcap"
    monkeypatch.setattr("host.recording.sink.MAX_KEPT_BYTES", 2000)
    sink = writer(path)
    monkeypatch.setattr(os, "write", Disk(room=0))
    for at, chunk in enumerate(chunks(200)):
        sink.add_received(chunk)
        sink.flush_if_due(MONO + at * 10**8)
    assert len(sink.unwritten) <= 2000
    assert "are lost" in sink.problem
    monkeypatch.setattr(os, "write", WRITE)
    sink.close()
    got = list(RecordingReader(path).chunks())
    assert got == chunks(200)[: len(got)]
    assert got


@pytest.mark.skipif(sys.platform == "win32", reason="Windows does not let an open file be removed")
def test_a_recording_removed_meanwhile_is_written_again(tmp_path):
    path = tmp_path / "trial.mcap"
    sink = writer(path)
    for chunk in chunks():
        sink.add_received(chunk)
    sink.flush_if_due(MONO + 10**9)
    path.unlink()
    said = []
    sink.close(said.append)
    assert "removed meanwhile and written again" in said[0]
    assert list(RecordingReader(path).chunks()) == chunks()


def test_a_killed_capture_loses_a_tenth_of_a_second_at_most():
    assert LOOP_S * 1e9 + FLUSH_PERIOD_NS <= 100_000_000  # a chunk comes, waits for its turn, then for the flush


def test_flushed_data_is_in_the_file_while_it_is_still_being_written(tmp_path):
    path = tmp_path / "trial.mcap"
    sink = writer(path)
    for chunk in chunks():
        sink.add_received(chunk)
    sink.flush_if_due(MONO + 100_000_000)
    assert list(RecordingReader(path).chunks()) == chunks()
    sink.close()


def test_what_was_flushed_is_brought_to_the_disk_now_and_then_beside_the_capture(tmp_path, monkeypatch):
    let_go, synced = threading.Event(), []

    def slow_disk(descriptor):
        assert let_go.wait(HANG_S)
        synced.append(os.fstat(descriptor).st_size)

    monkeypatch.setattr(os, "fdatasync", slow_disk, raising=False)
    sink = RecordingSink(tmp_path / "a.bin")
    sink.write(b"x" * 1000)
    sink.flush()
    sink.sync_if_due(10**9)
    sink.write(b"y" * 500)
    sink.flush()
    sink.sync_if_due(5 * 10**9)  # the disk is still at the first: nobody waits, nobody queues
    assert sink.bytes_synced == 0
    let_go.set()
    wait_for(lambda: sink.bytes_synced == 1000, "the first bytes on the disk")
    sink.sync_if_due(6 * 10**9)
    wait_for(lambda: sink.bytes_synced == 1500, "all bytes on the disk")
    sink.sync_if_due(8 * 10**9)  # nothing new
    sink.close()
    assert len(synced) == 2
    assert not [thread for thread in threading.enumerate() if thread.name == "rotdrift-sync"]


def test_the_last_bytes_are_brought_to_the_disk_at_the_end_and_the_name_with_the_first(tmp_path, monkeypatch):
    synced = []
    monkeypatch.setattr(os, "fdatasync", lambda descriptor: synced.append(os.fstat(descriptor).st_size), raising=False)
    monkeypatch.setattr(os, "fsync", lambda descriptor: synced.append(stat.S_ISDIR(os.fstat(descriptor).st_mode)))
    sink = RecordingSink(tmp_path / "a.bin")
    sink.write(b"x" * 1000)
    sink.flush()
    sink.sync_if_due(10**9)
    wait_for(lambda: sink.bytes_synced == 1000, "the first bytes on the disk")
    sink.write(b"y" * 500)
    sink.close()
    assert sink.bytes_synced == 1500
    assert synced == ([1000, True, 1500] if os.name == "posix" else [1000, 1500])


def test_a_power_cut_costs_less_than_a_second_where_the_disk_needs_less_than_a_third():
    slowest_disk_ns = 333_000_000
    assert FLUSH_PERIOD_NS + 2 * LOOP_S * 1e9 + SYNC_NS + slowest_disk_ns < 1_000_000_000


def test_a_disk_that_hangs_does_not_hold_up_the_end(tmp_path, monkeypatch):
    let_go = threading.Event()
    monkeypatch.setattr(os, "fdatasync", lambda _descriptor: let_go.wait(HANG_S), raising=False)
    sink = RecordingSink(tmp_path / "a.bin")
    sink.write(b"x")
    sink.flush()
    sink.sync_if_due(10**9)
    sink.close()
    assert sink.bytes_synced == 0  # it closed while the disk still hung
    let_go.set()
