"""The way of a recording: read whole and chunk by chunk, replayed, scored, recovered."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from pathlib import Path
from random import Random

from analysis.series import AnalysisError
from firmware_protocol.can.counters import CanCounters
from host.capture.playback import recorded_actions, recorded_commands
from host.errors import HostError
from host.recording.load import RecordedTrial, load_trial, node_of
from host.recording.reader import RecordingReader
from host.recording.recovery import recover
from host.results.result import ScoreOptions
from tests.fuzz.result.records import mutated
from tests.fuzz.result.road import REFUSED, check_score, check_trial, demand, differences, outcome, play_live
from tests.fuzz.targets import one_sentence

WITHOUT_EDITS = ScoreOptions(honour_actions=False)
RECOVERED_EVERY = 3
"""One in so many inputs is recovered as well: that costs as much as all the rest."""


def folder() -> Path:
    """Return a folder of this process, in memory where there is one for that."""
    global _folder
    if _folder is None:
        memory = Path("/dev/shm")
        _folder = Path(tempfile.mkdtemp(prefix="rotdrift-fuzz-", dir=memory if memory.is_dir() else None))
        atexit.register(shutil.rmtree, _folder, ignore_errors=True)
    return _folder


_folder: Path | None = None


def recording(rng: Random) -> str:
    """A recording whose records are odd, to the result."""
    data, closed = mutated(rng)
    path = folder() / f"{os.getpid()}.mcap"
    path.write_bytes(data)
    trial, became = _followed(path, closed)
    if rng.randrange(RECOVERED_EVERY) == 0:
        _recovered(path, trial)
    return became


def _followed(path: Path, closed: bool) -> tuple[RecordedTrial | None, str]:
    try:
        trial = load_trial(path)
    except (HostError, AnalysisError) as error:
        one_sentence(error)
        return None, REFUSED
    check_trial(trial)
    demand(closed or trial.damage, "a recording without its end is reported")
    result = check_score(trial)
    if trial.actions:
        check_score(trial, WITHOUT_EDITS)
    reader = RecordingReader(path)
    chunks = list(reader.delivered())
    if not isinstance(trial.counters, CanCounters):
        n_bytes = sum(len(chunk.data) for chunk in chunks)
        demand(n_bytes == trial.counters.bytes, "as many bytes chunk by chunk", (n_bytes, trial.counters.bytes))
    live = play_live(chunks, recorded_commands(path), node_of(reader.header), recorded_actions(path))
    demand(live == trial.losses, "replayed and offline ledger", differences(live, trial.losses))
    return trial, outcome(result)


def _recovered(path: Path, trial: RecordedTrial | None) -> None:
    target = path.with_suffix(".clean.mcap")
    target.unlink(missing_ok=True)
    try:
        found = recover(path, target)
    except HostError as error:
        one_sentence(error)
        return
    try:
        clean = load_trial(target)
    except (HostError, AnalysisError) as error:
        one_sentence(error)
        return
    recovered = list(RecordingReader(target).chunks())
    others = [sentence for sentence in clean.damage if "recovered from" not in sentence]  # what the source lacked
    demand(not others, "what was recovered is whole", others)
    demand(len(recovered) == found.chunks, "as many chunks as were found", (len(recovered), found.chunks))
    check_trial(clean)
    # A file whose channels are described otherwise holds other chunks for a reader; compressed ones cannot be searched.
    if trial is not None and not trial.damage and list(RecordingReader(path).chunks()) == recovered:
        demand(clean.losses == trial.losses, "ledger of a recovered one", differences(clean.losses, trial.losses))
