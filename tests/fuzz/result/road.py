"""The whole way of an input: decoder, clock, ledger, cycles, score, result file, and the reader of that; live and not.

Every check is one that holds for any input. What does not hold is raised as :class:`BrokenError`, and anything else
that is raised is a find as well.
"""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Sequence
from dataclasses import fields

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.scoring.result import Result, parse_result, result_text
from analysis.series import AnalysisError
from firmware_protocol.can.counters import CanCounters
from firmware_protocol.packets import PacketType
from host.capture.playback import play
from host.errors import HostError
from host.links.transport import AnyChunk
from host.losses.ledger import LossReport
from host.recording.arrivals import RecordedRoundTrips
from host.recording.assembly import MAX_RUNS
from host.recording.load import RecordedTrial, assemble
from host.results.result import ScoreOptions, score_trial
from host.screen.screens import QuietScreen
from host.trial.live import Trial
from host.trial.operator import OperatorAction
from tests.fuzz.targets import check_ledger, one_sentence
from tests.memory_transport import MemoryTransport

MAX_STEP_DEG = 180.0 + 1e-9
STATES_EVERY = 5.0
"""The replay makes a picture of its state in every so many parts of a second of the recording."""
OPTIONS = ScoreOptions(clock=True)
REFUSED, NOT_SCORED, NOT_VALID, VALID = "refused", "not scored", "scored, not valid", "scored, valid"
"""What becomes of an input."""
LEFT_OUT = re.compile(r"(\d+) samples whose device time did not increase were left out")


class BrokenError(Exception):
    """Something that always holds does not; ``check`` names it."""

    def __init__(self, check: str, detail: object) -> None:
        super().__init__(f"{check}: {detail}")
        self.check = check


def demand(holds: object, check: str, detail: object = "") -> None:
    """Raise unless it holds."""
    if not holds:
        raise BrokenError(check, detail)


def follow(
    chunks: Sequence[AnyChunk], commands: Sequence[AnyChunk] = (), node: int | None = None, n_frames: int | None = None
) -> str:
    """Send what a link delivered through both paths to the result; return what became of it.

    Parameters
    ----------
    chunks : sequence of AnyChunk
        What the link delivered; host times do not fall.
    commands : sequence of AnyChunk
        What the host sent.
    node : int, optional
        Of the object on a bus.
    n_frames : int, optional
        Of a byte link, how many whole frames are among its bytes, where that is known.
    """
    live = play_live(chunks, commands, node)
    trips = RecordedRoundTrips()
    for command in commands:
        trips.feed_sent(command.data, command.host_time_ns)
    try:
        trial = assemble(chunks, "fuzz", node, trips)
    except (HostError, AnalysisError) as error:
        one_sentence(error)
        return REFUSED
    check_trial(trial, n_frames)
    result = check_score(trial)
    demand(live == trial.losses, "live and offline ledger", differences(live, trial.losses))
    return outcome(result)


def outcome(result: Result | None) -> str:
    """Return in a word what a score became."""
    return NOT_SCORED if result is None else VALID if result.valid else NOT_VALID


def play_live(
    chunks: Sequence[AnyChunk],
    commands: Sequence[AnyChunk] = (),
    node: int | None = None,
    actions: Sequence[OperatorAction] = (),
) -> LossReport:
    """Send chunks along the path of a live capture; return its ledger."""
    trial = Trial(node)
    play(
        MemoryTransport(chunks, ends=True),
        trial,
        QuietScreen(),
        threading.Event(),
        STATES_EVERY,
        actions,
        commands,
    )
    demand(not trial.failures, "no part of the live view fails", trial.failures)
    report = trial.assembler.losses()
    check_ledger(report)
    return report


def differences(one: LossReport, other: LossReport) -> str:
    """Return which numbers of two ledgers differ."""
    names = [item.name for item in fields(one)]
    return ", ".join(
        f"{name} {getattr(one, name)} and {getattr(other, name)}"
        for name in names
        if getattr(one, name) != getattr(other, name)
    )


def check_trial(trial: RecordedTrial, n_frames: int | None = None) -> None:
    """Demand of the samples and of the account that they fit each other."""
    losses, series, counters = trial.losses, trial.series, trial.counters
    check_ledger(losses)
    left_out = sum(int(found[1]) for note in series.notes if (found := LEFT_OUT.match(note)))
    demand(len(series) + left_out == losses.received, "every sample received is in the series, or stated as left out")
    demand((np.diff(series.index) > 0).all(), "numbers rise")
    demand(np.isfinite(series.times_s).all(), "times are finite")
    norms = np.linalg.norm(series.quats_wxyz, axis=1)
    demand(np.abs(norms - 1).max(initial=0) < 1e-9, "orientations are unit", norms)
    missing = sum(run.missing for run in trial.missing)
    if len(trial.missing) < MAX_RUNS:
        demand(missing == losses.missing, "runs make up what is missing", (missing, losses.missing))
    decoded = counters.packets.get(PacketType.ORIENTATION, 0)
    demand(losses.received + losses.duplicates <= decoded, "no sample is made up", (losses, decoded))
    if not isinstance(counters, CanCounters):
        parts = counters.delimiters + counters.frame_bytes + counters.skipped_bytes + counters.pending_bytes
        demand(counters.bytes == parts, "every byte is accounted for", counters)
        others = counters.malformed + counters.unknown_types + counters.unsupported_versions
        demand(counters.frames == sum(counters.packets.values()) + others, "every frame is accounted for", counters)
        if n_frames is not None:
            demand(counters.frames == n_frames, "every whole frame is received", (counters.frames, n_frames))
    for sentence in (*trial.problems, *trial.damage):
        demand(sentence.isprintable(), "sentences are printable", ascii(sentence))


def check_score(trial: RecordedTrial, options: ScoreOptions = OPTIONS) -> Result | None:
    """Score a trial and read the result file again; None where it cannot be scored."""
    try:
        result = score_trial(trial, options)
    except (HostError, AnalysisError) as error:
        one_sentence(error)
        return None
    text = result_text(result)
    again = parse_result(text.encode())
    demand(result_text(again) == text, "a result file is read as it was written")
    check_result(again, trial)
    return again


def check_result(result: Result, trial: RecordedTrial) -> None:
    """Demand of a result, as it was read from its file, that its parts fit each other and the account."""
    losses = result.losses
    assert losses is not None
    kinds = losses.received, losses.lost, losses.rejected, losses.dropped_by_device, losses.damaged_in_file
    demand(losses.produced == sum(kinds) and min(kinds) >= 0, "sum", losses)
    demand(losses.produced == trial.losses.produced, "the result has the account", losses)
    demand(0 <= losses.share <= 1, "share", losses.share)
    for cycle in result.losses_per_cycle or ():
        parts = (cycle.received, cycle.lost, cycle.rejected, cycle.dropped_by_device, cycle.damaged_in_file)
        demand(cycle.produced == sum(parts) and min(parts) >= 0, "sum of a cycle", cycle)
    for sentence in (*result.reasons, *result.warnings):
        demand(sentence.isprintable() and len(sentence) < 1000, "sentences of a result", ascii(sentence))
    times_s = result.endpoint_times_s
    demand((np.diff(times_s) > 0).all(), "end points rise", times_s)
    demand(result.valid == (result.theta_bar_deg is not None), "θ̄ where it is valid")
    demand(result.valid or result.reasons, "a reason where it is not")
    if result.theta_bar_deg is None:
        return
    demand(math.isfinite(result.theta_bar_deg) and 0 <= result.theta_bar_deg <= MAX_STEP_DEG, "θ̄", result.theta_bar_deg)
    demand(all(0 <= step <= MAX_STEP_DEG for step in result.steps_deg), "steps", result.steps_deg)
    if not result.excluded_cycles and len(result.endpoints) > 1:
        demand(len(result.steps_deg) == len(result.endpoints) - 1, "a step for each cycle")
        check_steps(result)


def check_steps(result: Result) -> None:
    """Demand that steps and θ̄ are those of the end points, as scipy works them out."""
    ends = Rotation.from_quat(result.endpoint_quats_wxyz, scalar_first=True)
    steps = ends[1:] * ends[:-1].inv()
    off_deg = np.abs(np.degrees(steps.magnitude()) - result.steps_deg).max()
    demand(off_deg < 1e-6, "steps are those of the end points", off_deg)
    quats = steps.as_quat()
    weights = np.linalg.eigvalsh(quats.T @ quats)
    if weights[-1] - weights[-2] > 1e-6 * len(quats):  # else any rotation between two is as good a mean
        assert result.theta_bar_deg is not None
        off_deg = abs(math.degrees(steps.mean().magnitude()) - result.theta_bar_deg)
        demand(off_deg < 1e-4, "θ̄ is that of the end points", off_deg)
