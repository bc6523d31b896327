"""Whatever a file holds, reading it gives a series or one sentence."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from analysis.formats import parse_columns, read_series
from analysis.scoring.choice import load_endpoints, parse_endpoints
from analysis.sensor.baseline_file import load_baseline
from analysis.series import AnalysisError
from tests import reader_files as files

in_one_folder = settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], max_examples=60, deadline=None
)

STARTS = [b"", b",ts,tx,ty,tz,rx,ry,rz\n", b"1,0,0,0,0,0,0,\n", b"time,qw,qx,qy,qz\n", b"Timestamp (us),W,X,Y,Z\n"]
CELLS = st.text("0123456789.,-+eE \n\r\tna#x;_\"'\x00\x1b", max_size=300).map(str.encode)


def one_sentence(error):
    text = str(error)
    return "\n" not in text and text.isprintable() and len(text) < 600


@in_one_folder
@given(st.sampled_from(STARTS), st.one_of(st.binary(max_size=300), CELLS))
def test_any_bytes(tmp_path, start, content):
    path = tmp_path / "a.csv"
    path.write_bytes(start + content)
    try:
        series = read_series(path)
    except AnalysisError as error:
        if not one_sentence(error):
            raise
    else:
        assert np.isfinite(series.quats_wxyz).all()


@in_one_folder
@given(st.sampled_from(["t42", "ndx", "tum"]), st.data())
def test_a_file_with_a_few_damaged_bytes(tmp_path, kind, data):
    path = tmp_path / "a.csv"
    getattr(files, kind)(path, n=30)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(bytes(content))
    try:
        series = read_series(path)
    except AnalysisError as error:
        if not one_sentence(error):
            raise
    else:
        aside = 0 if series.set_aside is None else len(series.set_aside.index)
        assert 25 <= len(series) + aside <= 32


@in_one_folder
@given(st.permutations(range(40)), st.lists(st.integers(0, 39), max_size=6))
def test_any_order_of_time_stamps_names_every_row(tmp_path, order, repeated):
    # Mostly increasing, some rows swapped or repeated: nothing is lost without being set aside.
    times = np.arange(40) / 100.0
    swaps = list(order[:4])
    times[swaps] = times[sorted(swaps)]
    times[[max(k, 1) for k in repeated]] = times[[max(k, 1) - 1 for k in repeated]]
    path = tmp_path / "a.csv"
    files.named(path, "time,qw,qx,qy,qz", n=40, times=times)
    series = read_series(path)
    named = set(series.index.tolist()) | set([] if series.set_aside is None else series.set_aside.index.tolist())
    assert named == set(range(40))
    for row in range(40):
        assert series.sample(row).time_s == pytest.approx(times[row], abs=1e-12)


@given(st.text(max_size=60))
def test_any_declaration(text):
    try:
        parse_columns(text)
    except AnalysisError as error:
        if not one_sentence(error):
            raise


COLUMNS = ["t", "qw", "qx", "qy", "qz", "e1", "e2", "e3", "px", "py", "pz", "ax", "ay", "az"]
SETTINGS = {
    "time": ["s", "ns"],
    "angle": ["deg", "rad"],
    "euler": ["intrinsic-zyx", "extrinsic-xyx", "intrinsic-zz", "zyx"],
    "length": ["inch"],
    "accel": ["g"],
    "product": ["jpl", "hamilton"],
    "maps": ["world-to-body", "body-to-world"],
}
WHOLE = [set(COLUMNS[:5]), set(COLUMNS[1:5]), {"t", "e1", "e2", "e3"}, set(COLUMNS[:5]) | {"px", "py", "pz"}]


@in_one_folder
@given(
    st.one_of(st.sampled_from(WHOLE), st.sets(st.sampled_from(COLUMNS))),
    st.fixed_dictionaries({}, optional={key: st.sampled_from(values) for key, values in SETTINGS.items()}),
)
def test_any_declaration_of_known_words(tmp_path, columns, settings):
    path = tmp_path / "a.csv"
    if not path.exists():
        files.named(path, "time,w,x,y,z", n=12)
    names = {"t": "time", **{key: "wxyz"[k % 4] for k, key in enumerate(COLUMNS[1:])}}
    text = ",".join(f"{key}={value}" for key, value in ({c: names[c] for c in sorted(columns)} | settings).items())
    try:
        series = read_series(path, columns=text, rate_hz=100.0)
    except AnalysisError as error:
        if not one_sentence(error):
            raise
    else:
        assert len(series) == 12


@in_one_folder
@given(st.one_of(st.binary(max_size=200), CELLS.map(lambda cells: b"row,reason\n" + cells)))
def test_any_list_of_end_points(tmp_path, content):
    path = tmp_path / "ends.csv"
    path.write_bytes(content)
    for load in (load_endpoints, load_baseline):
        try:
            load(path)
        except AnalysisError as error:
            if not one_sentence(error):
                raise


@given(st.text(max_size=40))
def test_any_end_points_on_the_command_line(text):
    try:
        parse_endpoints(text)
    except AnalysisError as error:
        if not one_sentence(error):
            raise
