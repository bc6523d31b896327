"""What times, counters and counts in a file make is bounded, each by a sentence, and nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest

import analysis.formats.parquet as parquet_module
import analysis.formats.ros.messages as bag_module
import analysis.formats.text_table as table_module
import host.clock.interval as interval_module
from analysis.cycles.online.angle import AnglePoint
from analysis.cycles.online.dwell import place_endpoint
from analysis.cycles.search import find_cycles
from analysis.cycles.settings import CycleSettings
from analysis.formats import SourceFile, read_series, write_series
from analysis.formats.parquet import read_parquet
from analysis.formats.ros_bag import read_ros_bag
from analysis.formats.rows.streams import StreamChoice
from analysis.sensor.baseline import measure_baseline
from analysis.series import BaselineError, OrientationSeries, ReaderError, WriterError
from host.clock.interval import RoundTrips, offset_interval
from host.links.can.logs import frame_batches
from host.recording.load import MAX_NOTES, load_trial
from tests import hostile_files, reader_files
from tests.recorded_trials import MONOTONIC_NS, write_recording

DAY_S = 86400.0


def swing(times_s):
    half = 0.3 * np.sin(2 * np.pi * times_s / 2.0)
    quats = np.column_stack((np.cos(half), np.sin(half), 0.0 * half, 0.0 * half))
    return OrientationSeries(times_s, quats, np.arange(len(times_s)))


def still(times_s):
    quats = np.tile([1.0, 0.0, 0.0, 0.0], (len(times_s), 1))
    return OrientationSeries(times_s, quats, np.arange(len(times_s)))


@pytest.mark.parametrize("n", [90, 110])
def test_rows_are_counted_while_they_are_read(tmp_path, monkeypatch, n):
    monkeypatch.setattr(table_module, "MAX_SAMPLES", 100 - table_module._HEAD_LINES)
    reader_files.named(tmp_path / "a.csv", n=n)  # with a line of names
    if n < 100:
        assert len(read_series(tmp_path / "a.csv")) == n
        return
    with pytest.raises(ReaderError, match="has more than 20 million lines; cut it into trials first"):
        read_series(tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("kind", "module", "read", "names"),
    [("parquet", parquet_module, read_parquet, "a.parquet"), ("ros2", bag_module, read_ros_bag, "bag")],
)
def test_samples_are_counted_before_and_while_they_are_read(tmp_path, monkeypatch, kind, module, read, names):
    write_series(swing(np.arange(50) / 10.0), tmp_path / names, kind)
    with SourceFile(tmp_path / names) as source:
        monkeypatch.setattr(module, "MAX_SAMPLES", 50)
        assert len(read(source, None, StreamChoice()).quats_wxyz) == 50
        monkeypatch.setattr(module, "MAX_SAMPLES", 49)
        with pytest.raises(ReaderError, match="million samples; cut it into trials first"):
            read(source, None, StreamChoice())


def test_a_baseline_of_too_many_days_is_refused(monkeypatch):
    monkeypatch.setattr("analysis.sensor.baseline.MAX_DAYS", 1)
    assert measure_baseline(still(np.arange(0.0, DAY_S + 1.0, 1800.0))).duration_s == DAY_S
    with pytest.raises(BaselineError, match=r"at most 1 days, not 1\.02: is the unit of time right"):
        measure_baseline(still(np.arange(0.0, DAY_S + 1801.0, 1800.0)))


def test_hours_that_make_too_large_a_grid_are_refused(monkeypatch):
    series = swing(np.arange(4000) / 10.0)
    assert find_cycles(series).valid
    monkeypatch.setattr("analysis.cycles.search.MAX_GRID_POINTS", 39_980)
    (reason,) = find_cycles(series).reasons
    assert reason == "0 hours are too long for one search: cut the recording into trials, or choose end points"


def test_a_period_that_no_memory_can_smooth_over():
    points = [
        AnglePoint(time_s=0.01 * k, angle_rad=float(np.sin(0.01 * k)), quat_wxyz=np.array([1.0, 0, 0, 0]), index=k)
        for k in range(315)
    ]
    settings = CycleSettings()
    usual, _ = place_endpoint(points, points[157], usual_rad=1.0, period_s=6.28, settings=settings)
    absurd, _ = place_endpoint(points, points[157], usual_rad=1.0, period_s=1e15, settings=settings)
    assert usual.time_s == pytest.approx(1.57, abs=0.02)
    assert 0.0 <= absurd.time_s <= 3.15


@pytest.mark.parametrize("gap_us", [0, 10**6, 3 * 10**15])
def test_windows_without_points_are_left_out_and_bound_nothing(monkeypatch, gap_us):
    rng = np.random.default_rng(3)
    late_us = np.sort(rng.integers(0, 40_000_000, 300))
    late_us[150:] += gap_us
    at_us = late_us[::20]
    trips = RoundTrips(1000 * at_us - 400_000, at_us, at_us + 100, 1000 * at_us + 700_000)
    mapped = (1000 * trips.receive_us, 1000 * trips.transmit_us)
    late_ns = rng.exponential(2e5, 300)
    monkeypatch.setattr(interval_module, "_FEW_WINDOWS", 0)
    sparse = offset_interval(late_us, late_ns, trips, mapped, 0.05, 1e-4)
    if gap_us < 10**9:
        monkeypatch.setattr(interval_module, "_FEW_WINDOWS", 10**9)
        assert offset_interval(late_us, late_ns, trips, mapped, 0.05, 1e-4) == sparse
    assert sparse.low_ns is not None
    assert sparse.low_ns <= sparse.high_ns


def test_a_clock_that_jumps_all_the_time_is_not_listed_jump_by_jump(tmp_path):
    trial = load_trial(hostile_files.device_clock_that_wraps_at_every_sample(tmp_path))
    assert len(trial.segments) > 3 * MAX_NOTES
    assert len(trial.series.notes) < 2 * MAX_NOTES
    assert f"{len(trial.segments) - MAX_NOTES - 1} more such places" in trial.series.notes


def test_times_that_no_clock_has(tmp_path):
    with pytest.raises(ReaderError, match=r"row 1: a time of 1e\+300 s \(1999 such rows\)"):
        read_series(hostile_files.csv_times_of_no_size(tmp_path))
    with pytest.raises(WriterError, match="a ROS time ends at 2147483648 s"):
        write_series(swing(2.0**31 - 1.0 + np.arange(4)), tmp_path / "bag", "ros2")


def test_frames_before_an_impossible_time_in_a_log_are_kept(tmp_path):
    path = hostile_files.candump_times_a_century_apart(tmp_path)
    reading = frame_batches(str(path), "candump")
    damage: list[str] = []

    def whole():
        end = yield from reading
        damage.extend(end[0])

    assert len(list(whole())) == 9  # a frame every 10^9 s: those before 9·10^9 s
    assert damage == ["1991 of 2000 lines are no candump lines and are left out"]


def test_a_recording_with_a_century_in_it_keeps_both_sides(tmp_path):
    trial = load_trial(hostile_files.host_times_a_century_apart(tmp_path))
    assert len(trial.series) == 4000
    whole = write_recording(
        tmp_path / "whole.mcap", hostile_files.samples(4000, lambda k: MONOTONIC_NS + 5_000_000 * k)
    )
    np.testing.assert_array_equal(load_trial(whole).series.quats_wxyz, trial.series.quats_wxyz)
