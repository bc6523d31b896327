"""A reader in a process of its own: what it yields comes through, and every limit ends it with half a sentence."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from analysis.confined.call import StoppedError, pieces_of
from analysis.confined.limits import BASE_MEMORY_BYTES, LEAST_S, MOST_MEMORY_BYTES, MOST_S, Limits
from analysis.confined.values import from_pieces, to_pieces
from analysis.formats.time_stamps import RawSamples
from analysis.series import ReaderError
from tests.unit.hostile_readers import ChoiceError
from tests.waiting import wait_for

ENOUGH = Limits(memory_bytes=1 << 30, seconds=60.0)
needs_address_space = pytest.mark.skipif(sys.platform != "linux", reason="RLIMIT_AS holds on Linux only")


def call(name, *arguments, limits=ENOUGH):
    """Pieces and value, or the pieces up to an error and that error."""
    pieces, answer = [], pieces_of(f"tests.unit.hostile_readers:{name}", *arguments, limits=limits)
    while True:
        try:
            pieces.append(bytes(next(answer)))
        except StopIteration as end:
            return pieces, end.value
        except (StoppedError, ReaderError) as error:
            return pieces, error


def test_pieces_and_value_come_through_whatever_is_printed_between():
    text = "θ \udc80 'x'"
    assert call("echoes", "θ") == (["θ".encode(), b""], ["θ"])
    with pytest.raises(StoppedError, match="UnicodeEncodeError"):
        list(pieces_of("tests.unit.hostile_readers:echoes", text, limits=ENOUGH))


@pytest.mark.parametrize(
    ("name", "limits", "words"),
    [
        ("never_ends", Limits(1 << 30, 1.0), "reading it did not end within 1 s of processor time"),
        ("only_waits", Limits(1 << 30, 0.05), "reading it did not end within 0.5 s"),
        pytest.param("takes_memory", ENOUGH, "it needs more than 1 GiB of memory", marks=needs_address_space),
        ("returns_without_end", Limits(1 << 30, 60.0, 5 << 20), "more than 5 MiB come out of it"),
        ("fills_the_disk", Limits(1 << 30, 60.0, 5 << 20), "more than 5 MiB come out of it"),
        ("fills_the_disk_in_small_files", Limits(1 << 30, 60.0, 5 << 20), "more than 5 MiB come out of it"),
        ("crashes", ENOUGH, "its reader crashed"),
        pytest.param(
            "grows_where_the_system_does_not_mind",
            Limits(8 << 30, 60.0),
            "it needs more than 8 GiB of memory",
            marks=pytest.mark.skipif(sys.platform == "win32", reason="no such measure there"),
        ),
    ],
)
def test_each_limit_ends_the_process_and_is_named(monkeypatch, name, limits, words):
    if name != "only_waits":  # a busy machine may take long over a second of processor time
        monkeypatch.setattr("analysis.confined.call.WALL_FACTOR", 200.0)
    pieces, error = call(name, limits=limits)
    assert isinstance(error, StoppedError)
    assert words in str(error)
    if name not in {"never_ends", "only_waits"}:  # which a busy machine may end before it starts
        assert len(pieces) == (5 if name == "returns_without_end" else 1)


def test_errors_of_the_function():
    pieces, error = call("refuses")
    assert (pieces, type(error), str(error)) == ([b"first"], ReaderError, "line 7: not a number")
    pieces, error = call("asks")
    assert (type(error), str(error), error.kind, error.names) == (
        ChoiceError,
        "two sensors: 1, 2",
        "sensor",
        ("1", "2"),
    )
    pieces, error = call("fails")
    assert (pieces, type(error), str(error)) == (
        [],
        StoppedError,
        r"KeyError: '\x1b[2J' (with 1 GiB of memory and 60 s)",
    )


def test_a_process_that_never_started_is_reported(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/bin/false")
    assert "crashed (exit code 1)" in str(call("echoes", "x")[1])


def test_leaving_early_ends_the_process(tmp_path):
    mark = tmp_path / "mark"
    answer = pieces_of("tests.unit.hostile_readers:sleeps", str(mark), limits=ENOUGH)
    next(answer)
    answer.close()
    wait_for(lambda: not is_running(int(mark.read_text())), "the reading process is gone")


def test_a_process_whose_parent_was_killed_ends(tmp_path):
    mark = tmp_path / "mark"
    code = (
        "from analysis.confined.call import pieces_of\nfrom analysis.confined.limits import Limits\n"
        f"list(pieces_of('tests.unit.hostile_readers:sleeps', {str(mark)!r}, limits=Limits(1 << 30, 600.0)))"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], cwd=Path(__file__).parents[2])
    try:
        wait_for(lambda: mark.exists() and mark.read_text(), "the reading process has started")
    finally:
        parent.send_signal(signal.SIGKILL) if sys.platform != "win32" else parent.kill()
        parent.wait(60)
    wait_for(lambda: not is_running(int(mark.read_text())), "the reading process is gone")


def is_running(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    status = Path(f"/proc/{pid}/stat")
    try:
        return not status.exists() or status.read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_limits_grow_with_the_file_up_to_a_bound():
    assert Limits.of_file(0) == Limits(BASE_MEMORY_BYTES, LEAST_S)
    assert BASE_MEMORY_BYTES < Limits.of_file(10**6).memory_bytes < Limits.of_file(10**7).memory_bytes
    assert Limits.of_file(10**12) == Limits(MOST_MEMORY_BYTES, MOST_S)


@dataclasses.dataclass(frozen=True)
class Texts:
    labels: npt.NDArray[np.str_] | None
    none: npt.NDArray[np.str_]
    flags: npt.NDArray[np.bool_]


def test_arrays_of_texts_and_of_nothing():
    texts = Texts(np.array(["θ", "", "ab"]), np.array(["", ""]), np.array([], dtype=bool))
    back = from_pieces((bytearray(piece) for piece in to_pieces(texts)), Texts)
    for name in ("labels", "none", "flags"):
        np.testing.assert_array_equal(getattr(back, name), getattr(texts, name))
    with pytest.raises(NotImplementedError):
        list(to_pieces(Texts(np.array([object()]), texts.none, texts.flags)))


def test_values_come_back_as_they_were():
    raw = RawSamples(
        quats_wxyz=np.arange(8.0)[::-1].reshape(2, 4).T[:, :1].repeat(4, axis=1),
        times_s=np.array([1.0, np.nan, -np.inf, 2**53]),
        convention="θ\n\x1b",
        notes=("a", ""),
        index=np.array([-(2**63), 2**63 - 1, 0, 1]),
        positions_m=np.empty((0, 3)),
    )
    back = from_pieces((bytearray(piece) for piece in to_pieces(raw)), RawSamples)
    for field in dataclasses.fields(RawSamples):
        ours, theirs = getattr(raw, field.name), getattr(back, field.name)
        if isinstance(ours, np.ndarray):
            assert ours.dtype == theirs.dtype
            np.testing.assert_array_equal(ours, theirs)
            theirs[...] = 0  # an array like any other
        else:
            assert ours == theirs
    with pytest.raises(ValueError):
        from_pieces([bytearray(b"[]")], RawSamples)
