"""Parquet tables as pandas, polars and pyarrow write them: dates, durations, missing values, sensors in a column."""

import numpy as np
import pytest

from analysis.formats import ReaderError, SeveralStreamsError, StreamChoice, read_series
from analysis.geometry import rotations
from tests import reader_files as files

pyarrow = pytest.importorskip("pyarrow", reason="the extra rotdrift[parquet] is not installed")
parquet = pytest.importorskip("pyarrow.parquet")
N = 60
TIMES, POSES, _ = files.motion(N)
QUATS = POSES.as_quat(scalar_first=True)
OTHER = rotations.multiply([0.9689124, 0.2474040, 0.0, 0.0], QUATS)
PARTS = ("qw", "qx", "qy", "qz")
PER_S = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}


def read(tmp_path, columns, **how):
    parquet.write_table(pyarrow.table(columns), tmp_path / "a.parquet")
    return read_series(tmp_path / "a.parquet", **how)


def table(time, quats=QUATS):
    return {"time": time, **dict(zip(PARTS, quats.T, strict=True))}


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
@pytest.mark.parametrize("kind", ["timestamp", "timestamp with zone", "duration", "time"])
def test_times_of_every_type(tmp_path, kind, unit):
    counts = pyarrow.array(np.round(TIMES * PER_S[unit]).astype(np.int64))
    types = {
        "timestamp": pyarrow.timestamp(unit),
        "timestamp with zone": pyarrow.timestamp(unit, tz="Europe/Zurich"),
        "duration": pyarrow.duration(unit),
        "time": pyarrow.time32("ms") if unit == "ms" else pyarrow.time64(unit),
    }
    time = (
        counts.cast(pyarrow.int32()).cast(types[kind]) if (kind, unit) == ("time", "ms") else counts.cast(types[kind])
    )
    series = read(tmp_path, table(time))
    np.testing.assert_allclose(series.times_s, TIMES, atol=1e-6)
    assert rotations.distance(series.quats_wxyz, QUATS).max() < 1e-9


def test_days_alone_are_no_times_of_samples(tmp_path):
    days = pyarrow.array(np.arange(N).astype(np.int32)).cast(pyarrow.date32())
    with pytest.raises(ReaderError, match="holds days"):
        read(tmp_path, table(days))


@pytest.mark.parametrize("missing", ["null", "nan"])
def test_missing_values_are_holes(tmp_path, missing):
    values = QUATS[:, 1].tolist()
    values[7] = None if missing == "null" else float("nan")
    series = read(tmp_path, table(TIMES) | {"qx": values})
    assert series.index.tolist() == [k for k in range(N) if k != 7]
    assert "1 of 60 rows have no orientation and are left out" in series.warnings[0]


@pytest.mark.parametrize("labels", [["left", "right"], [1, 2], [b"a", b"b"]])
@pytest.mark.parametrize("name", ["sensor", "device_id", "frame_id"])
def test_sensors_in_a_column(tmp_path, name, labels):
    time = np.repeat(TIMES, 2) + np.tile([0.0, 0.003], N)
    quats = np.stack((QUATS, OTHER), axis=1).reshape(-1, 4)
    columns = table(time, quats) | {name: labels * N}
    with pytest.raises(SeveralStreamsError, match="two sensors: ") as seen:
        read(tmp_path, columns)
    series = read(tmp_path, columns, choice=StreamChoice(sensor=seen.value.names[1]))
    assert rotations.distance(series.quats_wxyz, OTHER).max() < 1e-9


def test_sessions(tmp_path):
    again = {name: np.tile(values, 2) for name, values in table((TIMES - TIMES[0]) * 10).items()}
    with pytest.raises(SeveralStreamsError, match="two sessions: "):
        read(tmp_path, again)
    assert len(read(tmp_path, again, choice=StreamChoice(session=2))) == N
