"""The conversation with an object, on a clock that the test turns."""

import numpy as np
import pytest

from firmware_protocol.items import ForeignInfo
from firmware_protocol.packets import (
    Ack,
    AckCode,
    DeviceState,
    GetInfo,
    Info,
    Mark,
    OrientationBatch,
    SetRate,
    Start,
    Status,
    Stop,
    TimeReply,
    TimeRequest,
)
from host.errors import NoAnswerError, WrongObjectError
from host.stream.blocks import RESET
from host.stream.session import Phase, Session, SessionSettings

MS = 1_000_000
SAMPLES = OrientationBatch(
    np.zeros(1, np.uint16), np.zeros(1, np.uint32), np.array([[1.0, 0, 0, 0]]), np.zeros(1, np.uint8)
)


class Object:
    """An object that does as it is told, but for what it is told not to answer."""

    def __init__(self, deaf_to=(), codes=(), boot_id=1, streams=False, lost=0):
        self.deaf_to = deaf_to
        self.codes = dict(codes)
        self.boot_id = boot_id
        self.streaming = streams
        self.lost = lost
        self.heard = []

    def answer(self, command, now_ns):
        self.heard.append(type(command).__name__)
        if self.lost > 0:
            self.lost -= 1
            return []
        if type(command) in self.deaf_to:
            return []
        code = self.codes.get(type(command), AckCode.OK)
        if isinstance(command, TimeRequest):
            return [TimeReply(command.command_id, now_ns // 1000 + 10, now_ns // 1000 + 12)]
        if code is AckCode.OK and isinstance(command, Start):
            self.streaming = True
        if isinstance(command, Stop):
            self.streaming = False
        ack = [Ack(command.packet_type, command.command_id, code)]
        return [*ack, Info(device_id=7, boot_id=self.boot_id)] if isinstance(command, GetInfo) else ack


def converse(session, device, until, limit_s=20.0, start_ns=0):
    """Turn the clock in steps of 10 ms until a condition holds; return the time it took."""
    now_ns = start_ns
    while not until() and now_ns - start_ns < limit_s * 1e9:
        now_ns += 10 * MS
        answers = [item for command in session.due(now_ns) for item in device.answer(command, now_ns)]
        if device.streaming:
            answers.append(SAMPLES)
        session.feed(answers, 30 * len(answers), now_ns + MS)
    return (now_ns - start_ns) / 1e9


def session_for(**settings):
    return Session(SessionSettings(**settings), "serial:/dev/test", 0, encode=lambda command: command)


def test_a_good_object_is_asked_started_and_stopped():
    session, device = session_for(rate_hz=200), Object()
    took = converse(session, device, lambda: session.phase is Phase.STREAMING)
    assert took < 0.1
    assert device.heard == ["GetInfo", "SetRate", "Start"]
    assert session.info.device_id == 7
    assert session.expected_rate_hz == 200
    session.stop()
    assert converse(session, device, lambda: session.phase is Phase.STOPPED) < 0.1
    assert not device.streaming
    assert session.error is None
    assert session.warnings == []


def test_the_rate_is_left_alone_unless_asked_for():
    session, device = session_for(), Object()
    converse(session, device, lambda: session.phase is Phase.STREAMING)
    assert "SetRate" not in device.heard
    assert session.expected_rate_hz == 100


def test_commands_that_get_lost_are_sent_again():
    session, device = session_for(rate_hz=100), Object(lost=3)
    took = converse(session, device, lambda: session.phase is Phase.STREAMING)
    assert session.error is None
    assert device.heard == ["GetInfo"] * 4 + ["SetRate", "Start"]
    assert 1.4 < took < 1.8


def test_silence_is_an_error_in_time():
    session = session_for(handshake_s=3.0)
    took = converse(session, Object(deaf_to=(GetInfo,)), lambda: session.error is not None)
    assert isinstance(session.error, NoAnswerError)
    assert "no data came within 3 s" in str(session.error)
    assert session.error.remedy
    assert 3.0 <= took < 3.1


def test_noise_is_told_from_silence():
    session = session_for(handshake_s=1.0)
    session.feed([], 4000, MS)
    converse(session, Object(deaf_to=(GetInfo,)), lambda: session.error is not None)
    assert "sends bytes (4000 in 1 s)" in str(session.error)
    assert "baud" in session.error.remedy


def test_a_mute_object_that_streams_is_captured_and_said():
    session, device = session_for(), Object(deaf_to=(GetInfo,), streams=True)
    took = converse(session, device, lambda: session.phase is Phase.STREAMING)
    assert session.one_way
    assert "does not answer" in session.warnings[0]
    assert took < 2
    heard = len(device.heard)
    converse(session, device, lambda: False, limit_s=3, start_ns=10**10)
    assert len(device.heard) == heard  # left in peace
    session.stop()
    assert session.phase is Phase.STOPPED


@pytest.mark.parametrize(("major", "remedy"), [(2, "update rotdrift"), (0, "update the object's firmware")])
def test_another_protocol_version_is_refused_with_both_versions(major, remedy):
    session = session_for()
    session.feed([ForeignInfo(major, 3)], 20, MS)
    assert isinstance(session.error, WrongObjectError)
    assert f"version {major}.3" in str(session.error)
    assert session.error.remedy == remedy


def test_a_refused_rate_and_a_refused_start_are_errors():
    session = session_for(rate_hz=5000)
    converse(session, Object(codes={SetRate: AckCode.INVALID_ARGUMENT}), lambda: session.error is not None)
    assert "refuses 5000 Hz (invalid argument)" in str(session.error)
    session = session_for()
    converse(session, Object(codes={Start: AckCode.HARDWARE_FAULT}), lambda: session.error is not None)
    assert "does not start to stream (hardware fault)" in str(session.error)


def test_an_object_that_streams_already_may_refuse_to_start():
    session = session_for()
    converse(
        session, Object(codes={Start: AckCode.WRONG_STATE}, streams=True), lambda: session.phase is Phase.STREAMING
    )
    assert session.error is None
    assert not session.one_way


def test_a_start_nobody_acknowledges_is_an_error_unless_data_flow():
    session = session_for()
    took = converse(session, Object(deaf_to=(Start,)), lambda: session.error is not None)
    assert isinstance(session.error, NoAnswerError)
    assert "did not answer START" in str(session.error)
    assert took < 3
    session = session_for()
    converse(session, Object(deaf_to=(Start,), streams=True), lambda: session.phase is Phase.STREAMING)
    assert session.error is None
    assert "did not acknowledge START" in session.warnings[0]


def test_the_device_clock_is_asked_for_once_a_second():
    session, device = session_for(), Object()
    converse(session, device, lambda: False, limit_s=5.5)
    trips = session.take_round_trips()
    assert len(trips) == 5
    assert all(0 < trip.received_ns - trip.sent_ns < 20 * MS for trip in trips)
    assert all(trip.transmit_us - trip.receive_us == 2 for trip in trips)
    assert session.take_round_trips() == []


def test_after_a_reset_it_is_started_again():
    session, device = session_for(rate_hz=100), Object()
    converse(session, device, lambda: session.phase is Phase.STREAMING)
    device.streaming, device.boot_id = False, 2
    session.new_segment(RESET)
    session.feed([Info(device_id=7, boot_id=2)], 40, 10**10)
    converse(session, device, lambda: session.phase is Phase.STREAMING, start_ns=10**10)
    assert device.heard[-2:] == ["SetRate", "Start"]
    assert session.warnings == ["the object was reset during the capture"]


def test_an_idle_object_is_started_again_when_the_info_after_its_reset_got_lost():
    session, device = session_for(), Object()
    converse(session, device, lambda: session.phase is Phase.STREAMING)
    session.feed([Status(uptime_us=0, state=DeviceState.IDLE)], 40, 10**10)
    assert session.phase is Phase.STARTING


def test_another_object_on_the_same_link_is_refused():
    session, device = session_for(), Object()
    converse(session, device, lambda: session.phase is Phase.STREAMING)
    session.feed([Info(device_id=8, boot_id=1, name="sphere\x1b[2J")], 40, 10**10)
    assert "a second object answers on this line: sphere[2J (0000000000000008)" in str(session.error)


def test_stopping_does_not_wait_for_a_deaf_object():
    session, device = session_for(), Object(deaf_to=(Stop,))
    converse(session, device, lambda: session.phase is Phase.STREAMING)
    session.stop()
    assert converse(session, device, lambda: session.phase is Phase.STOPPED, start_ns=10**9) < 0.4


def test_marks_reach_an_object_that_listens():
    session, device = session_for(), Object()
    session.mark(3)
    assert not [c for c in session.due(1) if isinstance(c, Mark)]
    converse(session, device, lambda: session.phase is Phase.STREAMING)
    session.mark(3)
    assert [c.marker for c in session.due(10**9) if isinstance(c, Mark)] == [3]
