"""Small files as people have them, in ``tests/inputs``: each is read right, or refused with the true reason.

The motion in them has six cycles at 10 Hz (five end points in CAN logs) with 1.5° of drift about (0.30, 0.20, 0.93); a
second object drifts by 0.4°.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.command_line import rotdrift_here

INPUTS = Path(__file__).parents[1] / "inputs"
TOLERANCE_DEG = 0.02
EULER = "e1=yaw,e2=pitch,e3=roll,angle=deg,euler=intrinsic-zyx"
NODE_THREE = 1.494
"""Of the object on a CAN bus, whose quaternions are rounded."""

SCORED = [
    # file, arguments, θ̄ in deg, number of end points, words in warnings
    ("00-control/plain.csv", "", 1.502, 6, ""),
    ("00-control/second_object.csv", "", 0.405, 6, ""),
    ("01-header-quoted-comma/control.csv", f"--columns t=Time,{EULER}", 1.502, 6, ""),
    ("01-header-quoted-comma/quoted.csv", f"--columns t=#0,{EULER}", 1.502, 6, ""),
    ("01-header-quoted-comma/quoted_quaternion.csv", "", 1.502, 6, ""),
    ("02-appended-log/log_0.csv", "--session 1", 1.500, 6, ""),
    ("02-appended-log/log_0.csv", "--session 2", 0.391, 4, ""),
    ("02-appended-log/log_1.csv", "--session 1", 1.503, 6, ""),
    ("02-appended-log/log_1.csv", "--session 2", 0.413, 4, ""),
    ("02-appended-log/whole.csv", "--session 1", 1.503, 6, ""),
    ("02-appended-log/whole.csv", "--session 2", 0.400, 6, ""),
    ("03-counter-wrap/wrap_us.csv", "", 1.502, 6, ""),
    (
        "03-counter-wrap/wrap_us.csv",
        "--columns t=SampleTimeFine,time=us,qw=Quat_W,qx=Quat_X,qy=Quat_Y,qz=Quat_Z",
        1.502,
        6,
        "",
    ),
    ("05-sensor-id-column/offset.csv", "--sensor 1", 1.502, 6, ""),
    ("05-sensor-id-column/offset.csv", "--sensor 2", 0.405, 6, ""),
    ("06-tum-header-wxyz/tum.txt", "", 1.502, 6, ""),
    ("07-endpoints-decimal-comma/trial.csv", "--endpoints endpoints_point.csv", 1.505, 6, ""),
    ("07-endpoints-decimal-comma/trial.csv", "--endpoints endpoints_semicolon.csv", 1.505, 6, ""),
    ("09-seven-columns/running_row_number.csv", "", 0.388, 5, ""),
    ("10-rotation-vector/rvec.csv", "--columns t=time,rv1=rx,rv2=ry,rv3=rz", 1.502, 6, ""),
    ("12-mcap-mixed-encodings/control.mcap", "", 1.502, 6, ""),
    ("12-mcap-mixed-encodings/json_beside.mcap", "", 1.502, 6, ""),
    ("12-mcap-mixed-encodings/protobuf_beside.mcap", "", 1.502, 6, ""),
    ("13-mcap-other-definition/crlf.mcap", "", 1.502, 6, ""),
    ("14-mcap-profiles/no_profile.mcap", "", 1.502, 6, ""),
    ("14-mcap-profiles/ros1.mcap", "", 1.502, 6, ""),
    ("14-mcap-profiles/empty_definition.mcap", "", 1.502, 6, ""),
    ("15-tf-only/tf.mcap", "", 1.502, 6, ""),
    ("15-tf-only/pose_with_covariance.mcap", "", 1.502, 6, ""),
    ("17-can-two-objects/nodes_3_and_5.log", "", NODE_THREE, 5, "two nodes: 3, 5; node 3 is scored"),
    ("17-can-two-objects/nodes_3_and_5.log", "--node 5", 0.398, 5, ""),
    ("17-can-two-objects/stray_first.log", "", NODE_THREE, 5, "two nodes: 2, 3; node 3 is scored"),
    ("18-can-log-two-trials/ten_minutes_later.log", "--session 1", NODE_THREE, 5, ""),
    ("18-can-log-two-trials/ten_minutes_later.log", "--session 2", 0.398, 5, ""),
    ("19-asc-line/first.asc", "", NODE_THREE, 5, ""),
    ("19-asc-line/middle.asc", "", NODE_THREE, 5, ""),
    ("20-asc-negative-times/neg.asc", "", NODE_THREE, 5, ""),
    ("21-can-log-formats/pcan.trc", "", NODE_THREE, 5, ""),
    ("22-preambles/apdm.csv", "", 1.502, 6, ""),
    ("22-preambles/motive.csv", "", 1.502, 6, "2 of 140 rows have no orientation and are left out, 1.4 %"),
    ("22-preambles/mt_manager.txt", "", 1.502, 6, ""),
    ("22-preambles/opensense.sto", "", 1.502, 6, ""),
    ("22-preambles/sep_line.csv", "", 1.502, 6, ""),
    ("22-preambles/xsens_dot.csv", "", 1.502, 6, ""),
    ("23-dates/clock.csv", "", 1.502, 6, ""),
    ("23-dates/iso.csv", "", 1.502, 6, ""),
    ("24-holes/mocap_nan.csv", "", 1.502, 6, "2 of 140 rows have no orientation and are left out"),
    ("24-holes/plotjuggler.csv", "", 1.502, 6, ""),
    ("25-text-column/echo.csv", "--columns t=#1,qw=#2,qx=#3,qy=#4,qz=#5", 1.502, 6, ""),
]

REFUSED = [
    ("04-two-publishers/ros2.mcap", "", 4, "alternate between two orientations"),
    ("05-sensor-id-column/offset.csv", "", 4, "holds two sensors: 1, 2; choose with --sensor 1"),
    ("07-endpoints-decimal-comma/trial.csv", "--endpoints endpoints.csv", 2, "save the file with decimal points"),
    ("09-seven-columns/raw_with_id.csv", "", 4, "columns without names"),
    ("10-rotation-vector/rvec.csv", "", 4, "--columns t=…,rv1=rx,rv2=ry,rv3=rz where they are a rotation vector"),
    ("11-split-bag-qos/metadata_differs", "", 1, "fewer than 3 cycles"),
    ("21-can-log-formats/candump_default.log", "", 4, "log with `candump -l`"),
]


def arguments(file, more):
    path = INPUTS / file
    return [str(path), *(str(path.parent / word) if word.startswith("endpoints") else word for word in more.split())]


@pytest.mark.parametrize(("file", "more", "theta_deg", "n", "words"), SCORED)
def test_read_right(file, more, theta_deg, n, words):
    done = rotdrift_here("score", "--json", *arguments(file, more))
    result = json.loads(done.stdout)
    assert (done.returncode, result["valid"], result["n_endpoints"]) == (0, True, n)
    assert result["theta_bar_deg"] == pytest.approx(theta_deg, abs=TOLERANCE_DEG)
    assert words in " ".join(result["warnings"])
    if theta_deg == pytest.approx(1.5, abs=0.01) and "endpoints" not in more:
        assert result["axis"] == pytest.approx([0.301, 0.201, 0.932], abs=0.02)


@pytest.mark.parametrize(("file", "more", "code", "words"), REFUSED)
def test_refused_with_the_true_reason(file, more, code, words):
    done = rotdrift_here("score", *arguments(file, more))
    assert done.returncode == code
    assert words in " ".join((done.stdout + done.stderr).split())


@pytest.mark.parametrize(
    ("file", "thetas_deg"),
    [
        ("02-appended-log/log_0.csv", (1.500, 0.391)),
        ("02-appended-log/log_1.csv", (1.503, 0.413)),
        ("02-appended-log/whole.csv", (1.503, 0.400)),
        ("18-can-log-two-trials/ten_minutes_later.log", (NODE_THREE, 0.398)),
    ],
)
def test_sessions_of_one_file_are_scored_apart(file, thetas_deg):
    done = rotdrift_here("score", "--json", str(INPUTS / file))
    rows = json.loads(done.stdout)["results"]
    assert done.returncode == 0
    assert [row["session"] for row in rows] == [1, 2]
    assert [row["result"]["theta_bar_deg"] for row in rows] == pytest.approx(thetas_deg, abs=TOLERANCE_DEG)


def test_a_session_folder_is_scored_without_what_stands_beside_the_quaternions():
    done = rotdrift_here("score", "--json", str(INPUTS / "26-ximu3-session"))
    (row,) = json.loads(done.stdout)["results"]
    assert done.returncode == 0
    assert row["result"]["theta_bar_deg"] == pytest.approx(1.502, abs=TOLERANCE_DEG)


def test_every_input_is_in_a_table():
    listed = {name for name, *_ in (*SCORED, *REFUSED)}
    beside = {"07-endpoints-decimal-comma", "11-split-bag-qos", "26-ximu3-session"}
    for path in INPUTS.rglob("*.*"):
        name = path.relative_to(INPUTS)
        assert str(name) in listed or name.parts[0] in beside or not path.is_file(), name


@pytest.mark.parametrize(("missing", "valid"), [(1, True), (10, True), (16, False), (40, False)])
def test_a_trial_of_which_much_was_left_out_is_not_valid_unless_asked_for(tmp_path, missing, valid):
    lines = (INPUTS / "00-control/plain.csv").read_text().splitlines()
    for k in range(131 - missing, 131):  # behind the last end point, at 11.9 s, but for the longest of them
        lines[k] = lines[k].partition(",")[0] + ",,,,"
    path = tmp_path / "a.csv"
    path.write_text("\n".join(lines) + "\n")
    done = rotdrift_here("score", "--json", str(path))
    result = json.loads(done.stdout)
    share = missing / (len(lines) - 2)
    words = f"{missing} of {len(lines) - 1} rows have no orientation and are left out, {100 * share:.2g} %"
    assert (words in " ".join(result["warnings"])) is (share > 0.01)
    assert (done.returncode, result["valid"]) == ((0, True) if valid else (1, False))
    assert (f"too much was left out: {words}" in " ".join(result["reasons"])) is not valid
    asked = json.loads(rotdrift_here("score", "--json", "--from", "0", "--to", "9", str(path)).stdout)
    assert asked["valid"]
