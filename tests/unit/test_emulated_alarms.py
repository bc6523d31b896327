"""Every alarm from its cause: virtual object, faults, wire, the host's own path to the screen; in virtual time."""

import re
from dataclasses import replace

import pytest

from analysis.sensor.baseline import measure_baseline
from emulator.faults.definitions import FaultSettings, TimedFault
from host.recording.load import assemble
from host.trial.state import MISSED
from tests.faulty_trials import faulty_chunks
from tests.recorded_trials import scenario, virtual_chunks
from tests.watched_trials import watched

CHUNK_S = 0.05
SECONDS = {"period_s": 1.0, "cycles": 14, "lead_in_s": 1.0, "lead_out_s": 1.0}
"""A trial of one-second cycles."""


def alarms_of(faults=None, baseline=None, name="default", **tables):
    """Run a scenario through object, faults, wire and host; give the log of its alarms and the last state."""
    chosen = scenario(name, **{"motion": SECONDS} | tables)
    if faults is not None:
        chosen = replace(chosen, faults=faults)
    chunks, _ = faulty_chunks(chosen, CHUNK_S)
    return watched(chunks, baseline)


def only(log, kind, sentence):
    """Check that one alarm came up, once, with its sentence; return when."""
    assert log.kinds == [kind], log.raised
    when_s, _, said = log.raised[0]
    assert re.fullmatch(sentence, said), said
    assert len(f"ALARM {kind}: {said}") <= 80 or kind == "floor"
    return when_s


@pytest.mark.parametrize("name", ["alternating", "fast", "tempo", "two-hump"])
def test_an_ordinary_trial_raises_none(name):
    motion = {} if name == "fast" else {"cycles": 8}
    log, state = watched(virtual_chunks(scenario(name, motion=motion), CHUNK_S)[0])
    assert state.score.n_cycles >= 7
    assert log.raised == []


def test_rest_raises_none():
    log, _ = watched(virtual_chunks(scenario("static"), CHUNK_S, duration_s=40.0)[0])
    assert log.raised == []


def test_movement_without_cycles():
    """One way for thirty seconds: that is no cycle yet, whatever it will become."""
    log, _ = alarms_of(motion={"period_s": 60.0, "swing_deg": 170.0, "cycles": 1})
    when_s = only(log, "no cycles", r"1\d s of movement without a cycle: is one rotation repeated\?")
    assert 15.0 < when_s < 22.0
    assert [kind for _, kind in log.cleared] == ["no cycles"]  # by the first end point


def test_an_ambiguous_axis():
    """The way there about one axis and the way back about another."""
    log, _ = alarms_of(drift={"angle_deg": 80.0}, motion={**SECONDS, "period_s": 2.0})
    assert "axis" in log.kinds
    said = next(sentence for _, kind, sentence in log.raised if kind == "axis")
    assert said == "it turns about no single axis: cycles may end at the wrong moment"


def test_a_shrinking_swing():
    log, _ = alarms_of(motion={**SECONDS, "cycles": 16, "amplitude_trend": -0.5})
    when_s = only(log, "swing", r"down from 4\d° to 3\d°: is it slipping out of the hand\?")
    assert 6.0 < when_s < 16.0


def test_a_slip_in_the_hand():
    log, state = alarms_of(name="slip")
    when_s = only(log, "reorientation", r"cycle 6 moved it 8\.\d°: dropped, regrasped\? \(x: exclude\)")
    slipped = state.score.cycles[6]
    assert slipped.time_s < when_s < slipped.time_s + 0.5  # told as soon as the cycle is known


def test_a_fall():
    log, _ = alarms_of(motion={**SECONDS, "period_s": 0.4, "swing_deg": 150.0}, drift={"angle_deg": 0.4})
    assert log.kinds == ["reorientation"]
    assert re.fullmatch(r"it turned at \d{3,4}°/s: was it dropped\?", log.raised[0][2])


def test_losses_above_the_limit_and_their_end():
    faults = FaultSettings(drop_probability=0.04, rates_from_s=3.0, rates_until_s=9.0)
    log, _ = alarms_of(faults, motion={**SECONDS, "cycles": 24})
    when_s = only(log, "losses", r"\d\.\d % of the last samples are missing: check cable and distance")
    assert 3.0 < when_s < 9.0
    ((cleared_s, _),) = log.cleared
    assert 15.0 < cleared_s < 21.0


def test_few_losses_raise_none():
    faults = FaultSettings(drop_probability=0.002)
    log, state = alarms_of(faults)
    assert state.stream.losses.missing > 0
    assert log.raised == []


def test_a_clock_that_jumps():
    faults = FaultSettings(at=(TimedFault(kind="clock-step", at_s=6.3, by_s=-40.0),))
    log, state = alarms_of(faults)
    only(log, "clock", r"the device clock stepped; the host's clock places what follows")
    assert state.stream.segments == 2
    assert state.score.n_cycles >= 11


def test_an_object_that_is_reset():
    faults = FaultSettings(at=(TimedFault(kind="reset", at_s=6.3, for_s=0.3),))
    log, _ = alarms_of(faults, motion={**SECONDS, "cycles": 20})
    assert log.kinds[0] == "clock"
    assert log.raised[0][2] == "the object was reset; the host's clock places what follows"


def test_a_saturated_sensor():
    log, _ = alarms_of(imu={"acceleration_noise_g": 5.0})
    only(log, "saturation", r"beyond the sensor's range: turn slower, or do not trust θ̄")


def test_a_drift_below_the_floor_of_the_sensor():
    """A hand without drift, and a sensor that turns 6 degrees a minute by itself, known from its rest."""
    imu = {"heading_drift_deg_per_min": 6.0}
    rest = assemble(virtual_chunks(scenario("static", imu=imu), CHUNK_S, duration_s=40.0)[0], "rest")
    baseline = measure_baseline(rest.series)
    log, state = alarms_of(baseline=baseline, drift={"mode": "none"}, imu=imu)
    sentence = r"θ̄ is below the sensor's floor of 0\.1\d*°, no drift at all looks the same; more cycles help"
    only(log, "floor", sentence)
    assert state.score.theta_bar_deg < state.sensor.floor_deg
    drifting, _ = alarms_of(baseline=baseline, imu=imu)
    assert drifting.raised == []


def test_a_cable_that_is_pulled_is_counted_and_no_slip():
    faults = FaultSettings(at=(TimedFault(kind="unplug", at_s=7.2, for_s=3.0),))
    log, state = alarms_of(faults)
    assert state.stream.reconnects == 1
    assert set(log.kinds) == {"losses", "link"}
    # The step over the cycles that nobody saw is no step: it must not make the drift look larger.
    assert [row.excluded for row in state.score.cycles if row.excluded] == [MISSED]
    assert state.score.theta_bar_deg == pytest.approx(0.8, abs=0.05)
