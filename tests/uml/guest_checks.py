"""Runs inside the user-mode kernel: our CAN links on real SocketCAN. Prints ``CHECK name ok`` or what went wrong.

Every check is a function of its own name; the tests outside expect one line each.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from host.recorded_trial import assemble
from host.transports.can_log import read_can_log
from tests.can_link_run import finish, object_on, open_transport, receive
from tests.can_traffic import joined

FINIT_MODULE = 313  # x86-64


def insert(*names: str) -> None:
    """Load kernel modules, dependencies first, without kmod."""
    libc = ctypes.CDLL(None, use_errno=True)
    for name in names:
        path = next(Path("/usr/lib/uml/modules").glob(f"{os.uname().release}/**/{name}.ko"))
        with path.open("rb") as file:
            if libc.syscall(FINIT_MODULE, file.fileno(), b"", 0) and ctypes.get_errno() != 17:
                raise OSError(ctypes.get_errno(), f"insmod {name}")


def sh(*words: str) -> None:
    subprocess.run(words, check=True, timeout=20)


def wait_until(condition, limit_s: float = 10.0) -> None:
    deadline = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline, "did not happen in time"
        time.sleep(0.01)


@contextlib.contextmanager
def running(*words: str) -> Iterator[subprocess.Popen]:
    process = subprocess.Popen(words)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(10)


def capture(address: str, n: int = 200, uri: str | None = None) -> None:
    with object_on(address) as (own, _), open_transport(uri or own) as transport:
        got = receive(transport, lambda got: got.n_samples >= n, 200, limit_s=60)
        finish(transport, got)
    check_whole(got)


def check_whole(got) -> None:
    counters = got.link.counters
    assert counters.samples_lost == 0, counters
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
            wait_until(lambda: Path("/sys/class/net/slcan0").exists())
            sh("ip", "link", "set", "slcan0", "up")
            with open_transport("can:socketcan:slcan0?node=5") as transport:
                got = receive(transport, lambda got: got.n_samples >= 200, 200, limit_s=60)
                finish(transport, got)
    check_whole(got)
    assert got.session.info is not None


def candump_and_canplayer() -> None:
    log = Path(tempfile.mkdtemp()) / "trial.log"
    with log.open("w") as file:
        dump = subprocess.Popen(["candump", "-L", "vcan0"], stdout=file)
        time.sleep(0.5)
        with object_on("can:socketcan:vcan0?node=6", "fast") as (own, _), open_transport(own) as transport:
            got = receive(transport, lambda got: got.n_samples >= 600, limit_s=60)
            finish(transport, got)
        dump.terminate()
        dump.wait(10)
    own_trial = assemble(got.chunks, "own", 6)
    dumped = assemble(read_can_log(log).chunks, "candump", 6)
    assert np.array_equal(own_trial.series.index, dumped.series.index), (len(own_trial.series), len(dumped.series))
    assert np.array_equal(own_trial.series.quats_wxyz, dumped.series.quats_wxyz)
    player = ("canplayer", "-I", str(log), "vcan1=vcan0")
    with open_transport("can:socketcan:vcan1?node=6") as transport, running(*player):
        chunks = []
        quiet = 0
        while quiet < 15:
            chunk = transport.read(0.1)
            quiet = 0 if chunk is not None else quiet + 1
            chunks += [chunk] if chunk is not None else []
    played = assemble(chunks, "canplayer", 6)
    assert np.array_equal(own_trial.series.quats_wxyz, played.series.quats_wxyz)


def link_down_and_up_during_a_capture() -> None:
    with object_on("can:socketcan:vcan2?node=7") as (own, _), open_transport(own) as transport:
        got = receive(transport, lambda got: got.n_samples >= 100, 200, limit_s=60)
        sh("ip", "link", "set", "vcan2", "down")
        with contextlib.suppress(AssertionError):
            receive(transport, lambda _: transport.health.is_down, limit_s=3, got=got)
        assert transport.health.is_down
        assert "is down" in transport.problems[0]
        sh("ip", "link", "set", "vcan2", "up")
        seen = got.n_samples
        receive(transport, lambda got: got.n_samples >= seen + 200, limit_s=30, got=got)
        finish(transport, got)
    assert transport.health.outages >= 1


def filters_are_in_the_kernel() -> None:
    with object_on("can:socketcan:vcan0?node=8"), open_transport("can:socketcan:vcan0?node=9") as transport:
        deadline = time.monotonic() + 1.5
        while time.monotonic() < deadline:
            assert transport.read(0.1) is None
        assert transport.health.filtered_frames == 0  # none reached us to be filtered here


def ports_lists_the_interfaces() -> None:
    from host.transports.can_listing import list_can_ports

    links = {port.link: port for port in list_can_ports()}
    assert links["can:socketcan:vcan0"].state == "up"


CHECKS = (
    vcan_classic,
    vcan_fd,
    kernel_slcan_against_our_adapter,
    candump_and_canplayer,
    link_down_and_up_during_a_capture,
    filters_are_in_the_kernel,
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
