"""A recording of a bus with two objects is replayed and recovered as the object that was captured."""

import re

import pytest

from host.links.transport import FrameChunk
from host.recording import format as fmt
from host.recording.load import load_trial, node_of
from host.recording.reader import RecordingReader
from host.recording.recovery import recover
from host.recording.writer import RecordingWriter
from tests.command_line import rotdrift_here
from tests.fuzz.result.frames import Heard as On
from tests.fuzz.result.frames import can_chunks, heard
from tests.fuzz.result.sessions import sessions
from tests.recorded_trials import MONOTONIC_NS, WALL_NS

FIVE_CYCLES, THREE_CYCLES = sessions()[0], sessions()[4]


@pytest.fixture
def bus(tmp_path):
    """Node 3, which is heard first, and node 4, which was captured."""
    frames = [*heard(FIVE_CYCLES, False, 3), *heard(THREE_CYCLES, False, 4)]
    line = [On(frame) for frame in sorted(frames, key=lambda frame: frame.host_time_ns)]
    path = tmp_path / "bus.mcap"
    writer = RecordingWriter(path, "can:vcan0?node=4", WALL_NS, MONOTONIC_NS)

    class Always:
        def choice(self, values):
            return values[0]

    for chunk in can_chunks(line, Always()):
        assert isinstance(chunk, FrameChunk)
        writer.add_received(chunk)
    writer.close()
    return path


def test_the_live_view_of_a_replay_follows_the_node_that_was_captured(bus):
    assert node_of(RecordingReader(bus).header) == 4
    trial = load_trial(bus)
    done = rotdrift_here("replay", bus, "--speed", "0", "--plain")
    assert trial.info.device_id == 0xB2
    periods = re.findall(r"^cycle +\d+ .* period +(\S+) s", done.stdout, re.MULTILINE)
    assert len(periods) == 2, done.stdout
    assert all(period[:3] in {"0.7", "0.8"} for period in periods)  # the other object's cycles take 0.4 s


def test_what_is_recovered_for_viewers_is_of_the_node_that_was_captured(bus, tmp_path):
    clean = tmp_path / "clean.mcap"
    recover(bus, clean)
    infos = {message.values()["device_id"] for message in RecordingReader(clean).messages({fmt.INFO})}
    assert infos == {0xB2}
