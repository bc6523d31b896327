"""Simulated links: when samples of a device with a wandering clock reach the host. Pure, seeded, vectorised.

Time is simulated host time. Every link draws, for the samples of one device, the host time of the read that delivered
them; samples of one read form a chunk. All of them lose the processor now and then, as on a loaded laptop.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class SimulatedLink:
    """What a host would see of n samples, and the truth."""

    name: str
    """Which link."""
    device_us: IntArray
    """(n,) device clock of each sample, not wrapped, us."""
    true_s: FloatArray
    """(n,) host time at which each sample was taken, s."""
    arrival_ns: IntArray
    """(n,) host time of the read that returned the sample, ns; equal within a chunk."""


def device_samples(
    rng: np.random.Generator, duration_s: float, rate_hz: float = 100.0, skew_ppm: float = 100.0
) -> tuple[IntArray, FloatArray]:
    """Return device clock readings (us) and true host times (s) of a device that samples by its own clock.

    Its rate is off by ``skew_ppm``, and wanders as a crystal does in an object that warms up (-8 ppm within 15 min),
    in a room whose temperature swings (3 ppm in 40 min), with a little random walk.
    """
    t = np.arange(0.0, duration_s + 60.0)  # knots, s
    ppm = skew_ppm - 8.0 * (1.0 - np.exp(-t / 900.0)) + 3.0 * np.sin(2 * np.pi * t / 2400.0)
    ppm += np.cumsum(rng.normal(0.0, 0.01, len(t)))
    device_s = np.concatenate([[0.0], np.cumsum(1.0 + 1e-6 * (ppm[1:] + ppm[:-1]) / 2)])
    sample_s = np.arange(1, int(duration_s * rate_hz)) / rate_hz + rng.uniform(0, 1 / rate_hz)
    sample_s += rng.normal(0.0, 3e-6, len(sample_s))  # interrupt latency in the device, before the clock is read
    return np.rint(1e6 * sample_s).astype(np.int64), np.interp(sample_s, device_s, t)


def wake_up(rng: np.random.Generator, at_s: FloatArray, busy: bool) -> FloatArray:
    """Return n delays until a blocked reader runs: 30 us, and in one of 200 a wait for the processor, 3 ms on average.

    On a ``busy`` machine load comes and goes every 20 s, and meanwhile one wake-up in five waits 10 ms on average.
    """
    loaded = busy & (at_s // 20.0 % 2 == 1)
    waits = rng.random(len(at_s)) < np.where(loaded, 0.2, 0.005)
    return rng.exponential(30e-6, len(at_s)) + np.where(waits, rng.exponential(np.where(loaded, 10e-3, 3e-3)), 0.0)


def next_poll(ready_s: FloatArray, interval_s: float, phase_s: float) -> FloatArray:
    """Return the first multiple of ``interval_s`` (plus ``phase_s``) not before ``ready_s``."""
    return np.ceil((ready_s - phase_s) / interval_s) * interval_s + phase_s


def read_times(rng: np.random.Generator, at_host_s: FloatArray, busy: bool) -> IntArray:
    """Return when the samples were read, ns; ``at_host_s`` is when the host had them, never going back."""
    times_s, inverse = np.unique(np.maximum.accumulate(at_host_s), return_inverse=True)
    woken_s = np.maximum.accumulate(times_s + wake_up(rng, times_s, busy))
    # A reader that woke late also finds what was delivered meanwhile: that is one chunk.
    woken_by = np.searchsorted(woken_s, times_s, side="left")
    return np.rint(1e9 * woken_s[woken_by[inverse]]).astype(np.int64)


def usb(rng: np.random.Generator, duration_s: float, busy: bool = False) -> SimulatedLink:
    """USB CDC: the host asks every millisecond (of the host controller's clock, here 20 ppm off the processor's)."""
    device_us, true_s = device_samples(rng, duration_s)
    ready_s = true_s + 0.4e-3 + rng.exponential(20e-6, len(true_s))
    return SimulatedLink(
        "USB, 1 ms polling", device_us, true_s, read_times(rng, next_poll(ready_s, 1e-3 * 1.00002, 0.2e-3), busy)
    )


def ftdi(rng: np.random.Generator, duration_s: float, busy: bool = False, poll_s: float = 125e-6) -> SimulatedLink:
    """FTDI bridge, 921600 baud: every 16 ms of its own clock it hands over what has come, at the next USB poll.

    A bulk endpoint is polled at least every micro-frame (125 us) by a high-speed host. An old full-speed host may poll
    every 1 ms: then both beats must come together for a sample to pass undelayed, which happens too rarely.
    """
    device_us, true_s = device_samples(rng, duration_s)
    ready_s = true_s + 0.7e-3 + rng.exponential(20e-6, len(true_s))
    flushed_s = next_poll(ready_s, 16e-3 * 0.99998, rng.uniform(0, 16e-3))
    name = f"FTDI, 16 ms latency timer, {1e3 * poll_s:g} ms polling"
    return SimulatedLink(name, device_us, true_s, read_times(rng, next_poll(flushed_s, poll_s * 1.00002, 0.2e-3), busy))


def ftdi_full_speed(rng: np.random.Generator, duration_s: float, busy: bool = False) -> SimulatedLink:
    """Return :func:`ftdi` behind a host that polls every 1 ms."""
    return ftdi(rng, duration_s, busy, poll_s=1e-3)


def can(rng: np.random.Generator, duration_s: float, busy: bool = False) -> SimulatedLink:
    """CAN, 1 Mbit/s, bus 30 % busy: a frame waits for the one under way."""
    device_us, true_s = device_samples(rng, duration_s)
    n = len(true_s)
    wait_s = np.where(rng.random(n) < 0.3, rng.uniform(0, 0.13e-3, n), 0.0)
    return SimulatedLink(
        "CAN", device_us, true_s, read_times(rng, true_s + 0.3e-3 + wait_s + rng.exponential(10e-6, n), busy)
    )


def ble(rng: np.random.Generator, duration_s: float, busy: bool = False) -> SimulatedLink:
    """BLE, connection interval 30 ms of the central's clock; one event in ten is lost and its samples come later."""
    device_us, true_s = device_samples(rng, duration_s)
    interval_s, phase_s = 30e-3 * 1.00001, rng.uniform(0, 30e-3)
    first = np.ceil((true_s + 1e-3 - phase_s) / interval_s).astype(np.int64)
    lost = rng.random(first[-1] + 100) < 0.1
    lost[-1] = False
    events = np.arange(len(lost))
    served = np.minimum.accumulate(np.where(lost, len(lost), events)[::-1])[::-1]  # next event that gets through
    through_s = events * interval_s + phase_s + 1e-3 + rng.exponential(0.2e-3, len(events))  # with the host's stack
    return SimulatedLink("BLE, 30 ms bursts", device_us, true_s, read_times(rng, through_s[served[first]], busy))


LINKS = {"usb": usb, "ftdi": ftdi, "ftdi_full_speed": ftdi_full_speed, "can": can, "ble": ble}
