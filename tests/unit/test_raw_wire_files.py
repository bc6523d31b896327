"""Bare bytes of our own wire, as an emulator writes them or a terminal program logs them, are a trial."""

import json

import numpy as np
import pytest

from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Event, EventKind
from firmware_protocol.serial.framing import encode_frame
from host.errors import FileError
from host.links.transport import Chunk
from host.recording.elsewhere.raw_bytes import NO_TIMES, is_raw_wire
from host.recording.load import assemble
from host.results.any_file import read_recording
from tests.command_line import rotdrift_here


@pytest.fixture(scope="module")
def wire(tmp_path_factory):
    """Bytes of a trial, and what is true of it."""
    folder = tmp_path_factory.mktemp("wire")
    done = rotdrift_here(
        "emulate", "--scenario", "ideal", "--link", f"file:{folder / 'raw.bin'}", "--duration", "30", "--truth",
        str(folder / "truth.json"),
    )  # fmt: skip
    assert done.returncode == 0
    return (folder / "raw.bin").read_bytes(), json.loads((folder / "truth.json").read_text())


def test_a_trial_of_bare_bytes_is_scored(tmp_path, wire):
    data, truth = wire
    path = tmp_path / "raw.bin"
    path.write_bytes(data)
    result = json.loads(rotdrift_here("score", "--json", str(path)).stdout)
    assert result["valid"]
    assert result["theta_bar_deg"] == pytest.approx(truth["theta_bar_deg"], abs=0.02)
    assert NO_TIMES in result["warnings"]


BEFORE = {
    "nothing": b"",
    "a boot message": b"rst:0x1 (POWERON_RESET)\r\nstarting\r\n",
    "half a packet": b"\x41\x17\x03\xff\x02\x00",
    "zeros": bytes(40),
    "random bytes": np.random.default_rng(3).bytes(500),
}


@pytest.mark.parametrize("before", BEFORE)
@pytest.mark.parametrize("cut", [0, 1, 17, 5000])
def test_whatever_stands_before_and_wherever_it_ends(tmp_path, wire, before, cut):
    data = BEFORE[before] + wire[0][: len(wire[0]) - cut]
    path = tmp_path / "log.txt"
    path.write_bytes(data)
    series, trial = read_recording(path)
    expected = assemble([Chunk(data, 0)], "own")
    np.testing.assert_array_equal(series.index, expected.series.index)
    np.testing.assert_array_equal(series.quats_wxyz, expected.series.quats_wxyz)
    assert len(series) > 2500
    assert trial.damage == (NO_TIMES,)


@pytest.mark.parametrize("data", [b"", bytes(5000), np.random.default_rng(1).bytes(60_000), b"t,qw\0\n" * 900])
def test_other_bytes_are_not_of_our_wire(data):
    assert not is_raw_wire(data)


def test_packets_without_samples_are_refused(tmp_path, wire):
    path = tmp_path / "raw.bin"
    path.write_bytes(b"".join(encode_frame(encode_packet(Event(k, EventKind.MARKER, k))) for k in range(5)))
    with pytest.raises(FileError, match="holds no samples"):
        read_recording(path)
