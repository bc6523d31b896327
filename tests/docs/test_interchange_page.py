"""Every row of docs/interchange.md on other programs is seen to happen here, with the version that it names."""

import importlib.metadata
import re
import shutil
import subprocess
from pathlib import Path

import can
import numpy as np
import pytest
from mcap.reader import make_reader

from analysis.formats import read_series, write_series
from analysis.formats.columns import _COLUMN_KEYS
from host.links.can.log_lines import _TRC_VERSIONS
from tests import reader_files as files
from tests import small_recordings
from tests.waiting import HANG_S

PAGE = (Path(__file__).parents[2] / "docs" / "interchange.md").read_text()


def cells(start):
    """The cells of the row of the page that starts so."""
    row = next(line for line in PAGE.splitlines() if line.startswith(f"| {start} |"))
    return [cell.strip() for cell in row.strip("|").split("|")]


@pytest.mark.parametrize(("package", "said"), [
    ("python-can", "python-can {} writes"), ("mcap", "| mcap {} (Python)"), ("rosbags", "| rosbags {} |"),
    ("pyarrow", "| pyarrow {} |"),
])  # fmt: skip
def test_versions_are_those_that_were_tried(package, said):
    major, minor, *_ = importlib.metadata.version(package).split(".")
    assert said.format(f"{major}.{minor}") in PAGE or said.format(major) in PAGE


FIRST = can.Message(
    timestamp=1.7e9 + 0.5, arbitration_id=0x183, is_extended_id=False, data=bytes(8), channel=1, is_rx=False
)
SECOND = can.Message(timestamp=1.7e9 + 0.6, arbitration_id=0x583, is_extended_id=False, is_fd=True, bitrate_switch=True,
                     data=bytes(24), channel=2)  # fmt: skip


@pytest.mark.parametrize("suffix", [".log", ".asc", ".blf", ".csv", ".trc"])
def test_what_python_can_keeps(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    with can.Logger(path) as logger:
        logger(FIRST)
        logger(SECOND)
    first, *more = can.LogReader(path)
    time = "kept" if first.timestamp == pytest.approx(FIRST.timestamp) else "from the first frame"
    assert time == "kept" or first.timestamp == 0.0
    channel = {1: "kept", "can1": "kept", 2: "one more than it was", None: "lost"}[first.channel]
    direction = "kept" if first.is_rx is False else "lost"
    fd = "not written"
    if more:
        fd = "kept" if more[0].is_fd and more[0].bitrate_switch else "lost: read as a classic frame"
    _, *said = cells(f"`{suffix}`")
    assert said == [time, channel, direction, fd]


def test_reverse_reading_of_a_recording(tmp_path):
    path = tmp_path / "a.mcap"
    writer = small_recordings.writer(path)
    for chunk in small_recordings.chunks():
        writer.add_received(chunk)
    writer.close()
    with path.open("rb") as file:
        forward = [message.log_time for _, _, message in make_reader(file).iter_messages()]
    with path.open("rb") as file:
        backward = [message.log_time for _, _, message in make_reader(file).iter_messages(reverse=True)]
    assert len(forward) == 20
    assert backward == forward
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    with rosbag2.Reader(path) as reader:
        assert sum(1 for _ in reader.messages()) == 20


def test_our_parquet_in_pyarrow(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    files.named(tmp_path / "a.csv")
    series = read_series(tmp_path / "a.csv")
    write_series(series, tmp_path / "a.parquet", "parquet")
    table = parquet.read_table(tmp_path / "a.parquet")
    assert {name: str(kind) for name, kind in zip(table.schema.names, table.schema.types, strict=True)} == {
        "row": "int64", "t_s": "double", "qw": "double", "qx": "double", "qy": "double", "qz": "double",
    }  # fmt: skip
    np.testing.assert_array_equal(table.column("t_s").to_numpy(), series.times_s)
    np.testing.assert_array_equal(np.stack([table.column(f"q{p}").to_numpy() for p in "wxyz"], 1), series.quats_wxyz)


@pytest.mark.skipif(shutil.which("octave") is None, reason="GNU Octave is not installed")
def test_nanoseconds_in_octave(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("1700000000000000001,1\n1700000000005000001,2\n")
    code = f"m = csvread('{path}'); printf('%s %.0f', class(m), m(2,1) - m(1,1));"
    done = subprocess.run(
        ["octave", "-q", "--eval", code],
        capture_output=True,
        text=True,
        timeout=HANG_S,
        check=True,
        stdin=subprocess.DEVNULL,
    )
    assert done.stdout == "double 4999936"
    assert "5 000 000 becomes 4 999 936" in PAGE


def test_every_key_of_columns_is_on_the_page():
    for key in _COLUMN_KEYS:
        assert f"`{key}`" in PAGE, key


def test_the_versions_of_trc_are_on_the_page():
    assert f"TRC {', '.join(_TRC_VERSIONS)}," in PAGE


def test_every_option_that_chooses_is_on_the_page():
    assert set(re.findall(r"`--(sensor|channel|node|session)", PAGE)) == {"sensor", "channel", "node", "session"}
