"""One emulated trial, sent over every link: the same samples, the same end points, the same score."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from analysis.rotations import distance
from analysis.scoring import score_series
from emulator.links import Link as ObjectLink
from emulator.links import open_link
from firmware_protocol.packets import OrientationBatch, PacketType
from firmware_protocol.quantization import SMALLEST_THREE_MAX_ERROR_DEG
from host.link import Link
from host.recorded_trial import assemble
from host.transports import open_transport
from host.transports.chunks import AnyChunk
from tests.can_link_run import LINKS
from tests.emulated_packets import trial_packets

SECONDS = 15.0


@pytest.fixture(scope="module")
def packets() -> list[bytes]:
    """What the object says in a trial that is started at once."""
    return trial_packets("fast", SECONDS)


def over(address: str, packets: list[bytes]) -> list[AnyChunk]:
    """Send packets over a link and return what the host receives."""
    wanted = sum(packet[0] == PacketType.ORIENTATION for packet in packets)
    chunks: list[AnyChunk] = []
    go, done = threading.Event(), threading.Event()
    with open_link(address) as link:
        thread = threading.Thread(target=send, args=(link, packets, go, done), daemon=True)
        thread.start()
        try:
            with open_transport(link.host_uri) as transport:
                go.set()
                decoder = Link()
                deadline = time.monotonic() + 60
                received = 0
                while received < wanted:
                    assert time.monotonic() < deadline, f"{received} of {wanted} samples came"
                    chunk = transport.read(0.05)
                    if chunk is not None:
                        chunks.append(chunk)
                        items = decoder.feed(chunk)
                        received += sum(len(item) for item in items if isinstance(item, OrientationBatch))
        finally:
            done.set()
            thread.join(10)
    return chunks


def send(link: ObjectLink, packets: list[bytes], go: threading.Event, done: threading.Event) -> None:
    """Be the object's end: answer the adapter's host, then send as fast as the link takes."""
    rest = packets
    while not done.is_set():
        link.receive()
        if go.is_set():
            taken = link.send(rest[:200])
            rest = rest[taken or 0 :]
        link.wait(0.002)


def test_every_link_gives_the_same_end_points_and_score(packets: list[bytes], request: pytest.FixtureRequest) -> None:
    trials = {
        name: assemble(over(address.format(name=request.node.name), packets), name) for name, address in LINKS.items()
    }
    reference = trials["pty"]
    expected = score_series(reference.series).to_json()
    assert expected["valid"], expected["reasons"]
    assert expected["n_endpoints"] >= 10
    for name, trial in trials.items():
        series = trial.series
        assert trial.losses.lost == trial.losses.rejected == 0, name
        assert np.array_equal(series.index, reference.series.index), name
        assert np.array_equal(series.times_s, reference.series.times_s), name
        classic = name in ("slcan-pty", "slcan-socket", "socketcand", "virtual")
        bound_deg = SMALLEST_THREE_MAX_ERROR_DEG if classic else 1e-9
        angles = np.degrees(distance(series.quats_wxyz, reference.series.quats_wxyz))
        assert angles.max() <= bound_deg, name
        assert (angles.max() > 1e-5) == classic, name
        score = score_series(series).to_json()
        ends = [point["sequence"] for point in score["endpoints"]]
        assert ends == [point["sequence"] for point in expected["endpoints"]], name
        # Each end point is off by at most the bound, and the score by its difference over all steps.
        assert score["theta_bar_deg"] == pytest.approx(expected["theta_bar_deg"], abs=2 * bound_deg), name
