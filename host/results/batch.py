"""Many recordings at once, over the cores; one bad file does not stop the rest, even if its process dies of it."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing import active_children, get_context
from pathlib import Path

from analysis.formats import is_diagnostic
from analysis.scoring.result import Result
from host.errors import FileError, HostError, UsageError
from host.output.streams import install
from host.results.any_file import ReadOptions, SeveralInFileError, score_recording
from host.results.result import ScoreOptions

SUFFIXES = frozenset({".bag", ".csv", ".mcap", ".parquet", ".pq", ".sto", ".tsv", ".tum", ".txt"})
"""What counts as a recording in a folder; the format itself is recognised from the content."""
MAX_FILES = 10_000
MAX_SESSIONS = 50
"""Of one file that are scored one by one."""


@dataclass(frozen=True, slots=True)
class BatchRow:
    """One recording of a batch."""

    path: Path
    result: Result | None
    """None where the file could not be scored."""
    error: str | None
    exit_code: int
    """As if the file had been scored alone: 0, 1 (not valid), 2 or 4."""
    session: int | None = None
    """Which session of the file, where it holds several; from 1 on."""


def expand(paths: Sequence[Path]) -> list[Path]:
    """Return the paths with folders replaced by the recordings in them, at any depth, in the order of their names.

    A ROS 2 bag is a folder too, and stays one. What x-IMU3 writes beside its quaternions is passed over.

    Raises
    ------
    FileError
        A folder without recordings.
    UsageError
        More files than make sense.
    """
    files: list[Path] = []
    for path in paths:
        if not path.is_dir() or _is_bag(path):
            files.append(path)
            continue
        found = sorted(_inside(path))
        if not found:
            raise FileError(f"the folder {path} has no recordings", f"they end in {', '.join(sorted(SUFFIXES))}")
        files += found
        if len(files) > MAX_FILES:
            raise UsageError(f"more than {MAX_FILES} files", "score them in parts")
    return list(dict.fromkeys(files))


def _inside(folder: Path) -> Iterator[Path]:
    for root, names, files in os.walk(folder):
        here = Path(root)
        bags = [name for name in names if _is_bag(here / name)]
        names[:] = [name for name in names if name not in bags and not name.startswith(".")]
        yield from (here / name for name in bags)
        yield from (
            here / name
            for name in files
            if Path(name).suffix.lower() in SUFFIXES
            and not name.startswith(".")
            and ".endpoints." not in name
            and not is_diagnostic(here / name)
        )


def _is_bag(path: Path) -> bool:
    return (path / "metadata.yaml").is_file()


def score_many(
    paths: Iterable[Path],
    report: Callable[[BatchRow], None],
    options: ScoreOptions | None = None,
    reading: ReadOptions | None = None,
    workers: int | None = None,
) -> list[BatchRow]:
    """Score files in parallel, by default with one process per core; the rows are in the order of ``paths``.

    A file of several sessions has a row for each.

    ``report`` is called in this process whenever a file is done, in any order. Every file is scored as
    :func:`host.results.any_file.score_recording` would with these options.
    """
    paths = list(paths)
    rows: dict[int, tuple[BatchRow, ...]] = {}
    unfinished = []
    workers = min(workers or os.cpu_count() or 1, len(paths), 61)  # 61: what Windows can wait for
    with _pool(workers) as pool:
        with _interrupts_not_inherited():
            jobs = {pool.submit(score_rows, path, options, reading): number for number, path in enumerate(paths)}
        for job in as_completed(jobs):
            try:
                rows[jobs[job]] = found = job.result()
            except BrokenProcessPool:
                unfinished.append(jobs[job])
                continue
            report(found[-1])
    # A process that is killed, e.g. for want of memory, ends the pool: whatever it did not finish is scored alone.
    for number in sorted(unfinished):
        with _pool(1) as pool:
            with _interrupts_not_inherited():
                job = pool.submit(score_rows, paths[number], options, reading)
            try:
                found = job.result()
            except BrokenProcessPool:
                killed = "the process that scored it was killed: not enough memory?"
                found = (BatchRow(paths[number], None, killed, 4),)
        rows[number] = found
        report(found[-1])
    return [row for number in range(len(paths)) for row in rows[number]]


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Yield processes that end with the block: at once where it is interrupted."""
    others = set(active_children())
    # A fresh interpreter each: a fork would inherit the progress bar's thread and its locks.
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=install)
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        while left := set(active_children()) - others:
            for process in left:
                process.kill()  # one that is still starting may not heed a request to end
                process.join()
        raise
    finally:
        pool.shutdown()


@contextmanager
def _interrupts_not_inherited() -> Iterator[None]:
    """Start processes that leave Ctrl-C, which reaches all of a terminal's, to this one."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def score_rows(path: Path, options: ScoreOptions | None, reading: ReadOptions | None) -> tuple[BatchRow, ...]:
    """Score one file, each of its sessions apart; whatever is wrong with it becomes part of the row."""
    try:
        result = score_recording(path, options, reading).result
    except SeveralInFileError as error:
        if error.kind != "session":
            return (BatchRow(path, None, str(error), error.exit_code),)
        if len(error.names) > MAX_SESSIONS:  # each reads the file again
            message = (
                f"{path.name} holds {len(error.names)} sessions, more than {MAX_SESSIONS}: choose one with --session"
            )
            return (BatchRow(path, None, message, error.exit_code),)
        reading = reading or ReadOptions()
        found: list[BatchRow] = []
        for session in range(1, len(error.names) + 1):
            one = replace(reading, choice=replace(reading.choice, session=session))
            found += (replace(row, session=session) for row in score_rows(path, options, one))
        return tuple(found)
    except HostError as error:
        return (BatchRow(path, None, str(error), error.exit_code),)
    except Exception as error:  # noqa: BLE001 - one bad file must not stop the rest
        return (BatchRow(path, None, f"a fault of rotdrift itself ({type(error).__name__}: {error})", 4),)
    return (BatchRow(path, result, None, 0 if result.valid else 1),)
