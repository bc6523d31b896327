"""A trial as it happens, against the truth and against the offline result."""

import numpy as np
import pytest
from msgspec import structs

from analysis.scoring.recorded_parts import CaptureAccount
from analysis.scoring.result import result_text
from host.capture.operator_desk import OperatorDesk
from host.capture.playback import play
from host.capture.snapshot import Snapshots
from host.links.transport import Chunk
from host.recording.load import assemble
from host.recording.replay_link import ReplayTransport
from host.results.parts import losses_per_cycle
from host.results.result import score_trial
from host.screen.screens import QuietScreen
from host.stop_signals import stop_on_signals
from host.stream.decoding import Link
from host.stream.rate import RateMeter
from host.trial.live import Trial
from host.trial.running_score import MAX_ROWS
from host.trial.state import LinkView, RecordingView
from tests.recorded_trials import scenario, virtual_chunks, write_recording
from tests.watched_trials import watched

NO_LINK = LinkView()


@pytest.fixture(scope="module")
def default():
    return virtual_chunks(scenario("default", motion={"cycles": 8}))


def followed(chunks, **options):
    trial = Trial(**options)
    rows = [row for chunk in chunks for row in trial.feed(chunk).cycles]
    return trial, rows


def test_cycles_are_found_while_they_happen_and_agree_with_the_truth(default):
    chunks, truth = default
    trial, rows = followed(chunks)
    assert [row.number for row in rows] == list(range(8))
    assert trial.n_endpoints == 8
    true_s = np.array([point["time_s"] for point in truth["endpoints"]])
    np.testing.assert_allclose(np.diff([row.time_s for row in rows]), np.diff(true_s), atol=0.05)
    assert rows[-1].theta_bar_deg == pytest.approx(truth["theta_bar_deg"], abs=0.1)
    assert rows[0].step_deg is rows[0].period_s is None
    offline = score_trial(assemble(chunks, "x"))
    assert rows[-1].theta_bar_deg == pytest.approx(offline.theta_bar_deg, abs=0.02)


def state_of(trial, now_ns, link=NO_LINK, warnings=()):
    return Snapshots(trial, OperatorDesk(trial)).at(now_ns, 12.5, link, RecordingView(), warnings)


def test_the_state_tells_what_a_screen_needs(default):
    chunks, _ = default
    trial, rows = followed(chunks)
    now_ns = chunks[-1].host_time_ns
    state = state_of(trial, now_ns, LinkView(name="memory:", expected_rate_hz=100.0), ("careful",))
    score = state.score
    assert score.n_cycles == 7
    assert score.cycles == tuple(rows)
    assert score.theta_bar_deg == rows[-1].theta_bar_deg
    assert score.interval_deg[0] < score.theta_bar_deg < score.interval_deg[1]
    assert state.motion.period_s == pytest.approx(4.0, abs=0.02)
    assert state.motion.swing_deg == pytest.approx(40.0, abs=1.0)
    assert state.sensor.name == "virtual cube"
    assert state.stream.rate_hz == pytest.approx(100.0, rel=0.02)
    assert state.stream.losses.missing == 0
    assert state.warnings == ("careful",)
    hash(state)  # frozen all the way down


def test_rows_are_bounded_however_long_the_trial(default):
    chunks, _ = virtual_chunks(
        scenario("ideal", motion={"cycles": MAX_ROWS + 20, "period_s": 0.5, "swing_deg": 20.0}), chunk_s=0.05
    )
    trial, rows = followed(chunks)
    assert len(rows) > MAX_ROWS
    score = state_of(trial, chunks[-1].host_time_ns).score
    assert len(score.cycles) == MAX_ROWS
    assert score.cycles[-1] == rows[-1]
    assert score.n_endpoints == len(rows)


def test_a_replay_goes_through_the_same_path(default, tmp_path):
    chunks, _ = default
    path = write_recording(tmp_path / "trial.mcap", chunks)
    live, _ = followed(chunks)
    again, screen = Trial(), QuietScreen()
    with ReplayTransport(path) as transport, stop_on_signals() as stop:
        assert play(transport, again, screen, stop)
        stop.set()
        assert not play(transport, Trial(), screen, stop)
    at = chunks[-1].host_time_ns
    assert state_of(again, at) == state_of(live, at)


def test_the_score_of_a_recording_has_where_it_came_from(default):
    chunks, truth = default
    trial = assemble(chunks, "a.mcap")
    capture = CaptureAccount(
        recording="a.mcap",
        ended="8 cycles are done",
        error=None,
        warnings=(),
        elapsed_s=40.0,
        clock=None,
        live_theta_bar_deg=None,
    )
    score = score_trial(trial, capture=capture)
    result = score.to_json()
    assert result["valid"]
    low, high = result["interval_deg"]
    assert low <= truth["theta_bar_deg"] <= high
    assert result["object"]["device_id"] == "0000000d21f70001"
    assert result["object"]["card"]["shape"] == "cube"
    assert result["losses"]["received"] == len(trial.series)
    assert result["missing_per_cycle"] == [0] * (result["n_endpoints"] - 1)
    assert score.capture == capture
    assert result["capture"]["ended"] == "8 cycles are done"
    assert "NaN" not in result_text(score)


def test_losses_reach_the_result(default):
    chunks, _ = default
    kept = [chunk for number, chunk in enumerate(chunks) if not 2000 <= number < 2030]
    result = score_trial(assemble(kept, "a.mcap")).to_json()
    assert result["losses"]["missing"] == 30
    assert sum(result["missing_per_cycle"]) == 30
    assert sum(cycle["lost"] for cycle in result["losses_per_cycle"]) == 30
    assert not any("degraded" in warning for warning in result["warnings"])
    kept = [chunk for number, chunk in enumerate(chunks) if number % 20]
    result = score_trial(assemble(kept, "a.mcap")).to_json()
    assert any("the score is degraded" in warning for warning in result["warnings"])
    assert result["losses"]["share"] == pytest.approx(0.05, abs=0.005)


def test_each_cycle_has_an_account():
    chunks, _ = virtual_chunks(scenario("ideal"), duration_s=3.0)
    whole = losses_per_cycle(assemble(chunks, "x"), [0.5, 1.0, 2.0])
    assert [cycle.produced for cycle in whole] == [50, 100]
    assert [cycle.missing for cycle in whole] == [0, 0]
    cut = assemble([chunk for number, chunk in enumerate(chunks) if not 90 <= number < 110], "x")
    before, after = losses_per_cycle(cut, [0.5, 1.0, 2.0])
    assert before.missing + after.missing == cut.losses.missing == 20
    assert structs.asdict(before) == {
        "produced": before.missing + 39,
        "missing": before.missing,
        "rejected": 0,
        "dropped_by_device": 0,
        "received": 39,
        "lost": before.missing,
        "damaged_in_file": 0,
    }
    assert losses_per_cycle(cut, [0.5]) == ()


def test_an_object_that_was_reset_is_scored_with_a_warning(default):
    chunks, _ = default
    shift_ns = chunks[-1].host_time_ns - chunks[0].host_time_ns + 1_500_000_000
    other_boot, _ = virtual_chunks(scenario("default", motion={"cycles": 5}), seed=99)
    again = [Chunk(chunk.data, chunk.host_time_ns + shift_ns) for chunk in other_boot]
    trial = assemble([*chunks, *again], "x")
    assert [segment.reason for segment in trial.segments][1:] == ["the object was reset"]
    assert trial.losses.segments == 2
    assert trial.losses.missing == 0
    result = score_trial(trial).to_json()
    assert any("was reset" in warning for warning in result["warnings"])
    assert result["link"]["resets"] == 1


def test_damaged_bytes_are_rejected_and_accounted(default):
    chunks, _ = default
    hurt = []
    for number, chunk in enumerate(chunks):
        data = bytearray(chunk.data)
        if number % 100 == 50:
            data[len(data) // 2] ^= 0x10
        hurt.append(Chunk(bytes(data), chunk.host_time_ns))
    losses = assemble(hurt, "x").losses
    assert losses.rejected > 20
    assert losses.lost <= 1  # a damaged delimiter joins two frames into one
    assert losses.produced == losses.received + losses.lost + losses.rejected + losses.dropped
    whole = sum(1 for chunk in chunks for _ in Link().feed(chunk))
    assert whole > losses.received


def test_the_rate_is_that_of_the_last_seconds():
    meter = RateMeter()
    assert meter.rate_hz(10**9) is None
    for k in range(1000):
        meter.add(2, k * 10_000_000)
    assert meter.rate_hz(10**10) == pytest.approx(200.0)
    assert meter.rate_hz(10**10 + 1_500_000_000) == pytest.approx(100.0)
    assert meter.rate_hz(20 * 10**9) == 0.0


def test_two_humps_a_cycle_are_one_cycle_once_the_pattern_is_known():
    """The first humps look like cycles of their own; they are taken back, and the rows begin again."""
    chunks, truth = virtual_chunks(scenario("two-hump", motion={"cycles": 12}))
    trial, _ = followed(chunks)
    score = state_of(trial, chunks[-1].host_time_ns).score
    numbers = [row.number for row in score.cycles]
    assert numbers == list(range(len(numbers)))
    true_s = np.diff([point["time_s"] for point in truth["endpoints"]])
    periods_s = [row.period_s for row in score.cycles[1:]]
    np.testing.assert_allclose(periods_s, np.median(true_s), atol=0.2)
    assert score.theta_bar_deg == pytest.approx(truth["theta_bar_deg"], abs=0.1)


def test_the_rest_before_the_motion_tells_the_floor_of_the_sensor():
    """As the score at the end has it: what creeps at rest is the sensor's own drift."""
    imu = {"heading_drift_deg_per_min": 3.0}
    motion = {"period_s": 1.0, "cycles": 6, "lead_in_s": 12.0, "lead_out_s": 0.5}
    state = watched(virtual_chunks(scenario("default", imu=imu, motion=motion), 0.05)[0])[1]
    assert state.sensor.heading_deg_per_min == pytest.approx(3.0, abs=0.5)
    assert 0.02 < state.sensor.floor_deg < 0.2
    for lead_in_s, tells_drift in ((2.0, False), (4.0, True)):  # too short for a floor
        chunks, _ = virtual_chunks(scenario("default", imu=imu, motion=motion | {"lead_in_s": lead_in_s}), 0.05)
        sensor = watched(chunks)[1].sensor
        assert (sensor.heading_deg_per_min is not None, sensor.floor_deg) == (tells_drift, None)
