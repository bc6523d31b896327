"""What goes between a capture and the process that draws it: whole frames, and cycles only when they are new."""

import io
import os
import threading
from dataclasses import replace

import pytest

from host.screen.keys import ScreenAction
from host.screen.pipe import Frame, FrameSender, Stop, decode_action, encode_action, receive, send
from host.trial.state import Alarm
from tests.unit.dashboard_states import ALARM, FINISHED, RUNNING


@pytest.fixture
def pipe():
    """Both ends of a pipe, as files."""
    reading, writing = os.pipe()
    with os.fdopen(reading, "rb") as end, os.fdopen(writing, "wb") as start:
        yield start, end


def test_messages_come_as_they_were_sent_and_a_cut_is_an_end_out_of_order():
    file = io.BytesIO()
    frame = Frame((RUNNING,), {0: RUNNING.score.cycles}, urgent=True)
    send(file, frame)
    send(file, Stop())
    whole = file.getvalue()
    file.seek(0)
    assert [receive(file) for _ in range(3)] == [frame, Stop(), Stop(in_order=False)]
    for length in (0, 1, 50, len(whole) // 2):
        assert receive(io.BytesIO(whole[:length])) == Stop(in_order=False)


def test_actions_are_lines():
    action = ScreenAction("exclude", 1, "it\nslipped", 4)
    line = encode_action(action)
    assert line.count(b"\n") == 1
    assert decode_action(line) == action
    assert decode_action(b"{}\n") is decode_action(b"junk\n") is None


def test_cycles_travel_when_they_are_new_and_alarms_ring_once(pipe):
    start, end = pipe
    sender = FrameSender(start, bell=True)

    def sent(state, index=0):
        sender.update(state, index)
        return receive(end)

    first = sent(RUNNING)
    assert first.cycles == {0: RUNNING.score.cycles}
    assert first.states == (RUNNING.with_cycles(()),)
    again = sent(replace(RUNNING, elapsed_s=62.0))
    assert (again.cycles, again.urgent, again.bell) == ({}, False, False)
    alarmed = sent(ALARM)
    assert (alarmed.cycles, alarmed.urgent, alarmed.bell) == ({}, True, True)
    louder = sent(replace(ALARM, alarms=tuple(Alarm(alarm.kind, "more") for alarm in ALARM.alarms)))
    assert (louder.urgent, louder.bell) == (True, False)  # the same kinds: a new sentence, but nothing to ring for
    second = sent(RUNNING, 1)
    assert list(second.cycles) == [1]
    assert len(second.states) == 2
    assert sent(FINISHED).bell
    sender.stop()
    assert receive(end) == Stop()
    sender.join(5.0)
    assert start.closed
    assert "rotdrift-screen" not in [thread.name for thread in threading.enumerate()]
