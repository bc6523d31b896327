"""The commands of README and the first pages do what they say: run as they stand, on files of an emulated object."""

import re
import shlex
import shutil
from contextlib import chdir

import pytest

from host import cli
from host.results.any_file import read_recording
from host.virtual_object_process import VirtualObjectProcess
from tests.command_line import quick_scenario
from tests.docs.test_documented_commands import DOCUMENTED
from tests.recorded_trials import scenario, virtual_chunks, write_recording

CAPTURE = "rotdrift capture serial:/dev/ttyACM0 --cycles 20"
AFTERWARDS = ("rotdrift score rotdrift-trials/TRIAL.mcap", "rotdrift replay rotdrift-trials/TRIAL.mcap")
ON_FILES = (
    "rotdrift ports",
    "rotdrift emulate --list",
    "rotdrift score cube_roll.mcap --baseline imu.toml --plot cube_roll.png",
    "rotdrift score trial.csv --columns t=time,qw=w,qx=x,qy=y,qz=z",
    "rotdrift score trials/ --json",
    "rotdrift recover trial.mcap clean.mcap",
    "rotdrift convert trial.mcap trial.mat",
    "rotdrift convert trial.mcap endpoints.csv --to endpoints",
    "rotdrift init --template",
    "rotdrift init --schema",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Files under the names that the pages use."""
    folder = tmp_path_factory.mktemp("documented")
    recording = write_recording(folder / "trial.mcap", virtual_chunks(scenario("fast", motion={"cycles": 12}))[0])
    shutil.copy(recording, folder / "cube_roll.mcap")
    (folder / "trials").mkdir()
    for name in ("one", "two"):
        shutil.copy(recording, folder / "trials" / f"{name}.mcap")
    series, _ = read_recording(recording)
    rows = zip(series.times_s.tolist(), series.quats_wxyz.tolist(), strict=True)
    lines = ["time,w,x,y,z", *(",".join(map(repr, [time_s, *quat])) for time_s, quat in rows)]
    (folder / "trial.csv").write_text("\n".join(lines) + "\n")
    write_recording(folder / "rest.mcap", virtual_chunks(scenario("static"), duration_s=90)[0])
    with chdir(folder):
        assert cli.main(["baseline", "rest.mcap", "--out", "imu.toml"]) == 0
    return folder


def run(line, **places):
    words = shlex.split(line, comments=True)[1:]
    for name, value in places.items():
        words = [word.replace(name, value) for word in words]
    return cli.main(words)


def test_commands_on_files(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    assert set(ON_FILES) <= {line for _, line in DOCUMENTED}, "no page has these commands any more"
    for line in ON_FILES:
        code = run(line)
        said = capsys.readouterr()
        assert code == 0, f"{line}: {said.err}"
        assert said.out, line
    assert (folder / "cube_roll.png").stat().st_size > 10_000
    assert {"clean.mcap", "trial.mat", "endpoints.csv"} <= {path.name for path in folder.iterdir()}


def test_the_main_job_of_the_readme(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert {CAPTURE, *AFTERWARDS} <= {line for page, line in DOCUMENTED if page == "README.md"}
    with VirtualObjectProcess(quick_scenario(tmp_path)) as virtual:
        assert run(CAPTURE, **{"serial:/dev/ttyACM0": virtual.link}) == 0
    (trial,) = (tmp_path / "rotdrift-trials").glob("*.mcap")
    measured = headline(capsys.readouterr().out)
    assert int(measured[1].split()[1]) >= 20
    for line in AFTERWARDS:
        assert run(line, TRIAL=trial.stem) == 0
        assert headline(capsys.readouterr().out) == measured


def headline(said):
    """The score, its interval and what it was measured over."""
    first, second = re.findall(r"^(?:rotation drift θ̄ = |motion +[0-9]+ cycles).*$", said, re.MULTILINE)
    return first, second
