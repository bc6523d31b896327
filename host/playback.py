"""A recording through the same path as a live capture, at any speed."""

from __future__ import annotations

import threading
from dataclasses import replace

from host.screen import Screen
from host.transports.chunks import LinkEnd, Transport
from host.trial import Trial
from host.trial_state import LinkView, RecordingView

STATE_NS = 100_000_000
READ_S = 0.05


def play(transport: Transport, trial: Trial, screen: Screen, stop: threading.Event, speed: float = 1.0) -> bool:
    """Feed a replay into a trial until its end.

    Nobody else waits for these chunks, so this thread reads them itself.

    Parameters
    ----------
    transport : Transport
        A replay; it does the pacing.
    trial : Trial
        Fresh.
    screen : Screen
        Started; shows the recording's own time.
    stop : threading.Event
        Ends it early.
    speed : float
        As given to the replay: how much recorded time passes between two pictures.

    Returns
    -------
    bool
        Whether it came to its end.
    """
    first_ns: int | None = None
    told_ns = 0
    while not stop.is_set():
        try:
            chunk = transport.read(READ_S)
        except LinkEnd:
            return True
        if chunk is None:
            continue
        now_ns = chunk.host_time_ns
        first_ns = now_ns if first_ns is None else first_ns
        for row in trial.feed(chunk).cycles:
            screen.cycle(row)
        if now_ns - told_ns >= STATE_NS * max(1.0, speed):
            told_ns = now_ns
            state = trial.state(now_ns, (now_ns - first_ns) / 1e9, LinkView(name=transport.name))
            recording = RecordingView(transport.name.removeprefix("replay:"), trial.link.n_bytes)
            screen.update(replace(state, recording=recording))
    return False
