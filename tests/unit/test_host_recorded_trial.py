"""Recordings of virtual objects, read back against the truth."""

import numpy as np
import pytest

from analysis.scoring.card import rotation_drift
from firmware_protocol.packets import OrientationBatch
from host.recording.load import assemble, load_trial
from host.stream.decoding import Link
from host.stream.samples import SampleAssembler
from tests.joined_blocks import series_of
from tests.recorded_trials import scenario, virtual_chunks, write_recording


@pytest.fixture(scope="module")
def ideal():
    return virtual_chunks(scenario("ideal", motion={"cycles": 4}))


def test_samples_at_the_true_end_points_give_the_true_score(ideal, tmp_path):
    chunks, truth = ideal
    trial = load_trial(write_recording(tmp_path / "trial.mcap", chunks))
    endpoints = [trial.series.sample(endpoint["sequence"]) for endpoint in truth["endpoints"]]
    drift = rotation_drift([endpoint.quat_wxyz for endpoint in endpoints])
    assert drift.theta_bar_deg == pytest.approx(truth["theta_bar_deg"], abs=0.01)
    assert trial.losses.missing == 0
    assert trial.losses.exact
    assert trial.info.name == "virtual cube"
    assert trial.damage == ()
    assert trial.header.link == "memory:"


def test_a_live_pass_a_joined_pass_and_a_recording_give_bit_identical_samples(ideal, tmp_path):
    chunks, _ = ideal
    link, assembler = Link(), SampleAssembler()
    blocks = [block for chunk in chunks for block in assembler.feed(link.feed(chunk), chunk.host_time_ns)]
    live = series_of(blocks, "live")
    for other in (assemble(chunks, "x"), load_trial(write_recording(tmp_path / "trial.mcap", chunks))):
        np.testing.assert_array_equal(other.series.times_s, live.times_s)
        np.testing.assert_array_equal(other.series.quats_wxyz, live.quats_wxyz)
        np.testing.assert_array_equal(other.series.index, live.index)
        assert other.losses == assembler.losses()


def test_removed_chunks_are_counted_exactly(ideal):
    chunks, _ = ideal
    whole = assemble(chunks, "x")
    removed = 0
    kept = []
    for number, chunk in enumerate(chunks):
        if number % 50 == 49:
            removed += sum(len(item) for item in Link().feed(chunk) if isinstance(item, OrientationBatch))
        else:
            kept.append(chunk)
    trial = assemble(kept, "x")
    assert removed > 10
    assert trial.losses.produced == whole.losses.produced
    assert trial.losses.missing == trial.losses.lost == removed


def test_a_cut_recording_is_read_up_to_the_cut(ideal, tmp_path):
    chunks, _ = ideal
    path = write_recording(tmp_path / "trial.mcap", chunks, close=False)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    trial = load_trial(path)
    whole = assemble(chunks, "x").series
    assert "was not closed" in trial.damage[0]
    assert 0 < len(trial.series) < len(whole)
    np.testing.assert_array_equal(trial.series.times_s, whole.times_s[: len(trial.series)])


def test_the_wrap_of_the_device_clock_inside_a_trial_changes_nothing():
    chunks, truth = virtual_chunks(scenario("clock-wrap", motion={"cycles": 8}))
    ticks = [
        tick
        for chunk in chunks
        for item in [*Link().feed(chunk)]
        if isinstance(item, OrientationBatch)
        for tick in item.device_time_us.tolist()
    ]
    assert min(np.diff(np.array(ticks, dtype=np.int64))) < -(2**31)  # it does wrap
    trial = assemble(chunks, "x")
    assert len(trial.segments) == 1
    assert np.diff(trial.series.times_s).max() < 0.02
    endpoints = [trial.series.sample(endpoint["sequence"]).time_s for endpoint in truth["endpoints"]]
    true_s = [endpoint["time_s"] + endpoint["sample_dt_s"] for endpoint in truth["endpoints"]]
    np.testing.assert_allclose(np.diff(endpoints), np.diff(true_s), atol=1e-3)
