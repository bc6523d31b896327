"""How far mapped sample times jitter over a real pseudo-terminal, with every core busy.

    python -m benchmarks.clock_pty [--duration 90] [--busy 2] [--rate 100]

A virtual object with a known clock (100 ppm fast, wandering by 10 ppm) runs in a process of its own; the capture's own
serial transport reads it; ``--busy`` processes do nothing but count. The error is mapped minus true sample time, less
its median, from the end of the warm-up on. The figures depend on the machine, so this is reported, not tested.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Event

import numpy as np
import numpy.typing as npt

from emulator.device.clock import ClockSettings, DeviceClock
from emulator.links import open_link
from emulator.runner import run
from emulator.scenario import Scenario, load_scenario
from firmware_protocol.packets import OrientationBatch, Start, TimeReply, TimeRequest
from firmware_protocol.serial.decoder import StreamDecoder, encode_command
from host.clock.estimator import ClockEstimator
from host.clock.remap import remap
from host.links import open_transport
from host.stream.samples import SampleAssembler

SEED = 7


def scenario(rate_hz: int) -> Scenario:
    """Return the object that is measured."""
    ordinary = load_scenario("default")
    return replace(
        ordinary,
        clock=ClockSettings(skew_ppm=100.0, wander_ppm=10.0, wander_period_s=600.0, start_us=2**32 - 20_000_000),
        device=replace(ordinary.device, rate_hz=rate_hz),
    )


def emulate(rate_hz: int, ready: Queue[str], stop: Event) -> None:
    """Run the object until told to stop."""
    flag = threading.Event()

    def pass_on() -> None:
        stop.wait()
        flag.set()

    threading.Thread(target=pass_on, daemon=True).start()
    run(scenario(rate_hz), open_link("pty:"), stop=flag, on_ready=ready.put, seed=SEED)


def count() -> None:
    """Keep one core busy."""
    n = 0
    while True:
        n += 1


@contextlib.contextmanager
def processes(rate_hz: int, busy: int) -> Iterator[str]:
    """Run object and load; yield the object's link."""
    context = multiprocessing.get_context("spawn")
    ready, stop = context.Queue(), context.Event()
    started = [context.Process(target=emulate, args=(rate_hz, ready, stop))]
    started += [context.Process(target=count, daemon=True) for _ in range(busy)]
    for process in started:
        process.start()
    try:
        yield ready.get(timeout=30.0)
    finally:
        stop.set()
        for process in started[1:]:
            process.terminate()
        for process in started:
            process.join(5.0)
            if process.is_alive():
                process.kill()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=90.0, help="seconds")
    parser.add_argument("--busy", type=int, default=os.cpu_count() or 1, help="processes that keep a core busy")
    parser.add_argument("--rate", type=int, default=100, help="samples per second")
    options = parser.parse_args()
    clock, assembler, decoder = ClockEstimator(), SampleAssembler(), StreamDecoder()
    unwrapped: list[npt.NDArray[np.int64]] = []
    mapped, arrivals = [], []
    assembler.on_samples.append(lambda samples: unwrapped.append(samples.device_time_us))
    sent_ns = next_request_ns = 0
    with processes(options.rate, options.busy) as uri, open_transport(uri) as transport:
        transport.write(encode_command(Start(1)))
        end_ns = time.monotonic_ns() + int(1e9 * options.duration)
        while time.monotonic_ns() < end_ns:
            chunk = transport.read(0.2)
            if chunk is None:
                continue
            for item in decoder.feed(chunk.data):
                if isinstance(item, OrientationBatch):
                    assembler.feed([item], chunk.host_time_ns)
                    mapped.append(clock.map(unwrapped[-1], chunk.host_time_ns))
                    arrivals.append(np.full(len(item), chunk.host_time_ns))
                elif isinstance(item, TimeReply):
                    receive_us = assembler.locate_us(item.receive_uptime_us, chunk.host_time_ns)
                    transmit_us = assembler.locate_us(item.transmit_uptime_us, chunk.host_time_ns)
                    if receive_us is not None and transmit_us is not None:
                        clock.feed_round_trip(sent_ns, receive_us, transmit_us, chunk.host_time_ns)
            if time.monotonic_ns() > next_request_ns:
                sent_ns = time.monotonic_ns()
                next_request_ns = sent_ns + 10**9
                transport.write(encode_command(TimeRequest(2)))
    estimate = clock.estimate()
    assert estimate is not None
    device_us, arrival_ns = np.concatenate(unwrapped), np.concatenate(arrivals)
    truth_ns = 1e9 * DeviceClock(scenario(options.rate).clock, SEED).time_s(device_us.astype(float))
    origin_ns = arrival_ns[0]

    def describe(what: str, host_ns: npt.NDArray[np.float64] | npt.NDArray[np.int64], after_s: float) -> None:
        late = arrival_ns - origin_ns > 1e9 * after_s
        error = (host_ns - origin_ns - truth_ns)[late]
        p50, p99, worst = 1e-6 * np.percentile(np.abs(error - np.median(error)), [50, 99, 100])
        print(f"{what:32} p50 {p50:7.4f} ms   p99 {p99:7.4f} ms   max {worst:7.4f} ms")

    print(f"{len(device_us)} samples at {options.rate} Hz, {options.busy} busy processes on {os.cpu_count()} cores")
    warm_s = options.duration / 2 if estimate.warm_up_s is None else estimate.warm_up_s
    describe("live, lower envelope", np.concatenate(mapped), warm_s)
    describe("offline, lower envelope", remap(device_us, arrival_ns).host_time_ns, 0.0)
    x, y = 1e-6 * (device_us - device_us[0]), 1e-9 * (arrival_ns - origin_ns)
    describe("offline, plain regression", origin_ns + 1e9 * np.polyval(np.polyfit(x, y, 1), x), 0.0)
    describe("arrival itself", arrival_ns, 0.0)
    low_ns = estimate.interval.low_ns
    interval = "none" if low_ns is None else f"{1e-6 * (estimate.interval.high_ns - low_ns):.3f} ms wide"
    warm = "never warm" if estimate.warm_up_s is None else f"warm after {warm_s:.0f} s"
    print(
        f"skew {estimate.skew_ppm:.1f} +- {estimate.skew_uncertainty_ppm:.1f} ppm, {warm}, "
        f"offset interval {interval}, segments {estimate.segment + 1}"
    )


if __name__ == "__main__":
    main()
