"""Runs inside the user-mode kernel: our CAN links on real SocketCAN. Prints ``CHECK name ok`` or what went wrong.

Every check is a function of its own name; the tests outside expect one line each.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
import socket
import struct
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.scoring.trial import score_series
from firmware_protocol.can.frames import FrameFlag
from firmware_protocol.packets import OrientationBatch, Start
from firmware_protocol.quantization import SMALLEST_THREE_MAX_ERROR_DEG
from firmware_protocol.serial.framing import encode_frame
from host.cli import main as rotdrift
from host.errors import LinkError
from host.links import open_lasting
from host.links.can.logs import read_can_log
from host.links.transport import Chunk, FrameChunk
from host.recording.load import assemble
from host.recording.reader import RecordingReader
from host.stream.decoding import Link
from tests.can_link_run import finish, object_on, open_transport, over, receive
from tests.can_traffic import joined
from tests.emulated_packets import trial_packets
from tests.uml.kernel_modules import insert
from tests.waiting import HANG_S, wait_for


def sh(*words: str) -> None:
    subprocess.run(words, check=True, timeout=HANG_S)


def read_into(chunks: list[FrameChunk], transport: Any) -> bool:
    """Keep what comes within a tenth of a second; return whether anything came."""
    chunk = transport.read(0.1)
    if chunk is not None:
        chunks.append(chunk)
    return chunk is not None


@contextlib.contextmanager
def running(*words: str, **options: Any) -> Iterator[subprocess.Popen]:
    process = subprocess.Popen(words, **options)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(HANG_S)


def capture(address: str, n: int = 200, uri: str | None = None) -> None:
    with object_on(address) as (own, _), open_transport(uri or own) as transport:
        got = receive(transport, lambda got: got.n_samples >= n, 200)
        finish(transport, got)
    check_whole(got)


def check_whole(got) -> None:
    counters = got.link.counters
    assert counters.malformed == counters.wrong_lengths == counters.long_packet_errors == 0, counters
    sequence = joined(got.items).sequence
    assert np.array_equal(np.diff(sequence), np.ones(len(sequence) - 1))


def vcan_classic() -> None:
    capture("can:socketcan:vcan0?node=3")


def vcan_fd() -> None:
    capture("can:socketcan:vcan0?node=4&fd=1")


def kernel_slcan_against_our_adapter() -> None:
    with object_on("can:slcan:pty?node=5") as (uri, _):
        device = uri.removeprefix("can:slcan:/dev/").partition("?")[0]  # slcand puts /dev/ in front
        with running("slcand", "-F", "-o", "-c", "-s6", device, "slcan0"):
            wait_for(Path("/sys/class/net/slcan0").exists, "the interface")
            sh("ip", "link", "set", "slcan0", "up")
            with open_transport("can:socketcan:slcan0?node=5") as transport:
                got = receive(transport, lambda got: got.n_samples >= 200, 200)
                finish(transport, got)
    check_whole(got)
    assert got.session.info is not None


def the_same_trial_by_capture_candump_and_canplayer() -> None:
    """One trial over vcan, in candump's log of it, and played again: all score as the packets themselves."""
    packets = trial_packets("fast", 51.0)
    serial = Chunk(b"".join(map(encode_frame, packets)), 0)
    reference = assemble([serial], "reference")
    log = Path(tempfile.mkdtemp()) / "trial.log"
    with log.open("w") as file:
        dump = subprocess.Popen(
            ["candump", "-L", "-T", "3000", "-r", "8000000", "vcan0"], stdout=file
        )  # ends after 3 s of silence
        # Before somebody listens the list says "(vcan0: no entry)".
        wait_for(
            lambda: re.search(r"^ *vcan0 ", Path("/proc/net/can/rcvlist_all").read_text(), re.MULTILINE), "a listener"
        )
        captured = over("can:socketcan:vcan0?node=6", packets)
        assert dump.wait(HANG_S) == 0
    player = ("canplayer", "-t", "-g", "0", "-I", str(log), "vcan1=vcan0")  # without pauses
    played: list[FrameChunk] = []
    with open_transport("can:socketcan:vcan1?node=6") as transport, running(*player) as process:
        wait_for(lambda: process.poll() is not None, "the end of canplayer", lambda: read_into(played, transport))
        quiet = 0
        while quiet < 5:
            quiet = 0 if read_into(played, transport) else quiet + 1
    expected = score_series(reference.series).to_json()
    assert expected["valid"], expected["reasons"]
    assert len(reference.series) >= 10_000
    scores = []
    for name, chunks in (("own", captured), ("candump", read_can_log(log).chunks), ("canplayer", played)):
        trial = assemble(chunks, name, 6)
        assert trial.losses.lost == trial.losses.rejected == 0, name
        assert np.array_equal(trial.series.index, reference.series.index), (name, len(trial.series))
        assert np.array_equal(trial.series.times_s, reference.series.times_s), name
        score = score_series(trial.series).to_json()
        ends = [point["sequence"] for point in score["endpoints"]]
        assert ends == [point["sequence"] for point in expected["endpoints"]], name
        assert abs(score["theta_bar_deg"] - expected["theta_bar_deg"]) <= 2 * SMALLEST_THREE_MAX_ERROR_DEG, name
        scores.append(score["theta_bar_deg"])
    assert len(set(scores)) == 1


def two_objects_on_one_bus_are_captured_at_once() -> None:
    """As a user does it: one ``rotdrift capture`` with two links."""
    bus, folder, said = "can:socketcan:vcan0", Path(tempfile.mkdtemp()), io.StringIO()
    links = [f"{bus}?node=3", f"{bus}?node=4"]
    with object_on(links[0], "fast"), object_on(links[1], "fast"), contextlib.redirect_stdout(said):
        code = rotdrift(["capture", *links, "--cycles", "4", "--out", str(folder / "both"), "--json"])
    assert code == 0, said.getvalue()
    results = json.loads(said.getvalue())["results"]
    for number, node in ((1, 3), (2, 4)):
        result = results[number - 1]["result"]
        assert result["valid"], result
        assert result["losses"]["lost"] == 0
        frames = [frame for chunk in RecordingReader(folder / f"both-{number}.mcap").chunks() for frame in chunk.frames]
        assert {frame.arbitration_id & 31 for frame in frames if not frame.flags & FrameFlag.SENT} == {node}


def error_frames_of_the_kernel_are_told() -> None:
    """Error frames sent on a raw socket come back from the kernel as a driver's own would."""
    said = {
        0x040: (b"", "bus-off"),
        0x020: (b"", "acknowledges"),
        0x004: (b"\0\1", "computer was too slow"),
    }
    with (
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as raw,
        object_on("can:socketcan:vcan0?node=11"),
        open_transport("can:socketcan:vcan0?node=11") as transport,
    ):
        raw.bind(("vcan0",))
        got = receive(transport, lambda got: got.n_samples >= 50, 200)
        for kind, (data, words) in said.items():
            raw.send(struct.pack("=IB3x8s", 0x20000000 | kind, 8, data))
            receive(transport, lambda _, w=words: any(w in each for each in transport.problems), got=got)
        finish(transport, got)
    assert transport.health.state == "bus-off"
    assert got.link.counters.error_frames == transport.health.error_frames == 3
    check_whole(got)


def link_down_and_up_during_a_capture() -> None:
    with object_on("can:socketcan:vcan2?node=7") as (own, _), open_transport(own) as transport:
        got = receive(transport, lambda got: got.n_samples >= 100, 200)
        sh("ip", "link", "set", "vcan2", "down")
        receive(transport, lambda _: transport.health.went_down, got=got)
        assert "went down" in transport.problems[0]
        sh("ip", "link", "set", "vcan2", "up")
        seen = got.n_samples
        receive(transport, lambda got: got.n_samples >= seen + 200, got=got)
        finish(transport, got)
    assert "went down" in transport.problems[0]  # whoever asks late is told as well


def filters_are_in_the_kernel() -> None:
    with object_on("can:socketcan:vcan0?node=8"), open_transport("can:socketcan:vcan0?node=9") as transport:
        deadline = time.monotonic() + 1.5
        while time.monotonic() < deadline:
            assert transport.read(0.1) is None
        assert transport.health.filtered_frames == 0  # none reached us to be filtered here


def an_interface_that_is_pulled_and_comes_back_is_opened_again() -> None:
    link = "can:socketcan:vcan3?node=7"

    def plug_in() -> None:
        sh("ip", "link", "add", "vcan3", "type", "vcan")
        sh("ip", "link", "set", "vcan3", "up")

    def samples(transport: Any, n: int) -> None:
        decoder, got = Link(node=7), []
        transport.write(transport.encode_command(Start(1)))

        def turn() -> None:
            chunk = transport.read(0.1)
            if chunk is not None and chunk.data:
                got.extend(item for item in decoder.feed(chunk) if isinstance(item, OrientationBatch))

        wait_for(lambda: sum(map(len, got)) >= n, lambda: f"{n} samples; {sum(map(len, got))} came", turn)

    plug_in()
    with contextlib.ExitStack() as first:
        first.enter_context(object_on(link))
        transport = first.enter_context(open_lasting(link, 20.0))
        samples(transport, 50)
        sh("ip", "link", "delete", "vcan3")
        wait_for(lambda: not transport.connected, "a lost link", lambda: transport.read(0.1))
        plug_in()
        wait_for(lambda: (chunk := transport.read(0.1)) is not None and not chunk.data, "the link's return")
        with object_on(link):
            samples(transport, 50)
        assert transport.reconnects == 1
    sh("ip", "link", "delete", "vcan3")


def interfaces_that_are_missing_or_down_are_told_at_once() -> None:
    sh("ip", "link", "set", "vcan2", "down")
    for channel, words in (("vcan9", "there is no CAN interface vcan9"), ("vcan2", "vcan2 is down")):
        with pytest.raises(LinkError, match=words) as told:
            open_transport(f"can:socketcan:{channel}?node=3")
        assert f"ip link set {channel} up" in str(told.value)
    sh("ip", "link", "set", "vcan2", "up")


def ports_lists_the_interfaces() -> None:
    from host.doctor.object_probe import objects_on
    from host.links.can.listing import list_can_ports

    links = {port.link: port for port in list_can_ports() if "vcan" in port.link}
    assert links["can:socketcan:vcan0"].state == "up"
    with object_on("can:socketcan:vcan0?node=21"):
        assert objects_on(list(links)) == {
            "can:socketcan:vcan0": ["can:socketcan:vcan0?node=21"],
            "can:socketcan:vcan1": [],
            "can:socketcan:vcan2": [],
        }


CHECKS = (
    vcan_classic,
    vcan_fd,
    kernel_slcan_against_our_adapter,
    the_same_trial_by_capture_candump_and_canplayer,
    link_down_and_up_during_a_capture,
    two_objects_on_one_bus_are_captured_at_once,
    error_frames_of_the_kernel_are_told,
    filters_are_in_the_kernel,
    an_interface_that_is_pulled_and_comes_back_is_opened_again,
    interfaces_that_are_missing_or_down_are_told_at_once,
    ports_lists_the_interfaces,
)


def main() -> int:
    insert("can", "can-raw", "can-dev", "vcan", "slcan")
    for name in ("vcan0", "vcan1", "vcan2"):
        sh("ip", "link", "add", name, "type", "vcan")
        sh("ip", "link", "set", name, "mtu", "72")
        sh("ip", "link", "set", name, "up")
    for check in CHECKS:
        started = time.monotonic()
        try:
            check()
        except Exception:  # noqa: BLE001
            traceback.print_exc(file=sys.stdout)
            print(f"CHECK {check.__name__} failed", flush=True)
        else:
            print(f"CHECK {check.__name__} ok {time.monotonic() - started:.1f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
