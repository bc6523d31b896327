"""A recording through the same path as a live capture, at any speed."""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from firmware_protocol.items import StreamItem
from firmware_protocol.packets import TimeReply
from host.capture.loop import STATE_NS
from host.capture.operator_desk import OperatorDesk
from host.capture.snapshot import Snapshots
from host.links.transport import AnyChunk, GapChunk, LinkEnd, Transport
from host.recording import format as fmt
from host.recording.arrivals import RecordedRoundTrips
from host.recording.reader import RecordingReader
from host.screen.guarded_screen import guarded
from host.screen.screens import Screen
from host.stream.round_trips import RoundTrip, round_trip
from host.trial.guarded import Guarded
from host.trial.live import Trial
from host.trial.operator import OperatorAction, action_of
from host.trial.state import LinkView, RecordingView, TrialState

READ_S = 0.05


def recorded_actions(path: Path) -> list[OperatorAction]:
    """Return what the operator did during a capture.

    Raises
    ------
    FileError
        Not a recording.
    """
    actions = []
    for message in RecordingReader(path).messages({fmt.ACTION}):
        with contextlib.suppress(ValueError, KeyError):  # damage is reported when the recording is scored
            actions.append(action_of(message.values()))
    return actions


def recorded_commands(path: Path) -> list[AnyChunk]:
    """Return what the host sent during a capture, in order; raises as :func:`recorded_actions`."""
    return list(RecordingReader(path).chunks(fmt.SENT))


def play(
    transport: Transport,
    trial: Trial,
    screen: Screen,
    stop: threading.Event,
    speed: float = 1.0,
    actions: Sequence[OperatorAction] = (),
    commands: Sequence[AnyChunk] = (),
    title: str = "rotdrift",
) -> TrialState | None:
    """Feed a replay into a new trial until its end; return its last state, None where ``stop`` ended it early.

    Nobody else waits for these chunks, so this thread reads them itself.

    Parameters
    ----------
    transport : Transport
        A replay; it does the pacing.
    screen : Screen
        Started; shows the recording's own time. Of its keys only those count that change no trial.
    speed : float
        As given to the replay: how much recorded time passes between two pictures.
    actions : sequence of OperatorAction
        What the operator did then; done again when its time comes.
    commands : sequence of AnyChunk
        What was sent then: with the answers they bound the offset of the clocks.
    """
    screen, waiting, unsent, trips = guarded(screen), deque(actions), deque(commands), RecordedRoundTrips()
    desk = Guarded("the operator's desk", OperatorDesk(trial), trial.failures, "what was done then is not done again")
    snapshots = Guarded(
        "the live view", Snapshots(trial, desk.subject, title), trial.failures, "the picture stands still"
    )
    first_ns: int | None = None
    published_ns = now_ns = 0
    shown, reported = TrialState(), set[str]()

    def state() -> TrialState:
        nonlocal shown
        info = trial.assembler.info
        link = LinkView(name=transport.name, expected_rate_hz=None if info is None else info.rate_hz)
        recording = RecordingView(transport.name.removeprefix("replay:"), trial.link.n_bytes, replayed=True)
        elapsed_s, warnings = 0.0 if first_ns is None else (now_ns - first_ns) / 1e9, tuple(trial.failures[-3:])
        stands_still = replace(shown, warnings=warnings)
        shown = snapshots.ask(lambda it: it.at(now_ns, elapsed_s, link, recording, warnings), stands_still)
        for sentence in (*trial.failures, *screen.problems):
            if sentence not in reported:
                reported.add(sentence)
                screen.report(f"note: {sentence}")
        return shown

    def repeat(action: OperatorAction) -> None:
        desk.ask(lambda operator: operator.repeat(action), None)

    while not stop.is_set():
        if any(action.kind == "finish" for action in screen.actions()):
            return None
        try:
            chunk = transport.read(READ_S)
        except LinkEnd:
            for row in trial.finish().cycles:
                screen.cycle(row)
            for action in waiting:
                repeat(action)
            return state()
        if chunk is None:
            continue
        if isinstance(chunk, GapChunk):  # which has no time of its own
            trial.feed(chunk)
            continue
        now_ns = chunk.host_time_ns
        first_ns = now_ns if first_ns is None else first_ns
        update = trial.feed(chunk)
        while unsent and unsent[0].host_time_ns <= now_ns:
            command = unsent.popleft()
            trips.feed_sent(command.data, command.host_time_ns)
        trial.feed_round_trips(_round_trips(trips, update.items, now_ns))
        for row in update.cycles:
            screen.cycle(row)
        while waiting and not waiting[0].time_s > trial.newest_s:  # one before the first sample has NaN for a time
            repeat(waiting.popleft())
        if now_ns - published_ns >= STATE_NS * max(1.0, speed):
            published_ns = now_ns
            screen.update(state())
    return None


def _round_trips(trips: RecordedRoundTrips, items: list[StreamItem], now_ns: int) -> Iterator[RoundTrip]:
    """Yield the round trips that end among the packets received at ``now_ns``."""
    for item in items:
        if isinstance(item, TimeReply) and (sent_ns := trips.sent_ns(item, now_ns)) is not None:
            found = round_trip(sent_ns, item, now_ns)
            if found is not None:
                yield found
