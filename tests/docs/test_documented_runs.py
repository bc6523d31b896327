"""The commands of README and the first pages do what they say: run as they stand, on files of an emulated object."""

import re
import shlex
import shutil
from contextlib import chdir
from pathlib import Path

import pytest

from host import cli
from host.results.any_file import read_recording
from host.virtual_object_process import VirtualObjectProcess
from tests.command_line import quick_scenario
from tests.docs.test_documented_commands import DOCUMENTED
from tests.emulated_submission import write_trials
from tests.recorded_trials import scenario, virtual_chunks, write_recording

ROOT = Path(__file__).parents[2]
ON_FILES = (
    "rotdrift ports",
    "rotdrift emulate --list",
    "rotdrift score trials/cube_roll.mcap --baseline trials/baseline.toml --plot cube_roll.png",
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
    (folder / "trials").mkdir()
    for name in ("cube_roll", "two"):
        shutil.copy(recording, folder / "trials" / f"{name}.mcap")
    series, _ = read_recording(recording)
    rows = zip(series.times_s.tolist(), series.quats_wxyz.tolist(), strict=True)
    lines = ["time,w,x,y,z", *(",".join(map(repr, [time_s, *quat])) for time_s, quat in rows)]
    (folder / "trial.csv").write_text("\n".join(lines) + "\n")
    write_recording(folder / "rest.mcap", virtual_chunks(scenario("static"), duration_s=90)[0])
    with chdir(folder):
        assert cli.main(["baseline", "rest.mcap", "--out", "trials/baseline.toml"]) == 0
    return folder


def run(line):
    return cli.main(shlex.split(line, comments=True)[1:])


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


def block(page, first):
    """The commands of the block of a page that starts with one, in their order."""
    text = (ROOT / page).read_text("utf-8")
    blocks = re.findall(r"```sh\n(.*?)```", text, re.DOTALL)
    (found,) = (lines.splitlines() for lines in blocks if lines.lstrip().startswith(first))
    return found


def test_the_main_job_of_the_readme_from_the_object_to_the_comparison(tmp_path, monkeypatch, capsys, folder):
    monkeypatch.chdir(tmp_path)
    write_trials(tmp_path / "lab", model="Gripper", cycles=5)
    assert cli.main(["report", *map(str, (tmp_path / "lab").glob("*.mcap")), "--out", "another_lab.zip"]) == 0
    cards = "\n".join(path.read_text() for path in sorted((tmp_path / "lab").glob("*.toml")))
    (tmp_path / "cards.toml").write_text(cards)
    instead = {
        "baseline": ("serial:/dev/ttyACM0", str(folder / "rest.mcap")),
        "init": ("init", "init --from cards.toml"),
    }
    printed = {}
    with VirtualObjectProcess(quick_scenario(tmp_path)) as virtual:
        for line in block("README.md", "rotdrift ports"):
            command = line.split()[1]
            old, new = instead.get(command, ("serial:/dev/ttyACM0", virtual.link))
            capsys.readouterr()
            assert run(line.replace(old, new)) == 0, line
            printed[command] = capsys.readouterr().out
    score, motion = headline(printed["capture"])
    assert int(motion.split()[1]) >= 20
    assert headline(printed["score"]) == (score, motion)
    theta = re.search(r"θ̄ = ([0-9.]+)", score)[1]
    assert theta in printed["report"]
    assert printed["verify"].startswith("equal")
    assert theta in printed["compare"]
    assert "Gripper" in printed["compare"]
    capsys.readouterr()
    assert run("rotdrift replay trials/cube_roll.mcap") == 0
    assert re.search(r"θ̄ = ([0-9.]+)", headline(capsys.readouterr().out)[0])[1] == theta


def headline(printed):
    """The score with its interval, which is the last thing printed, and what it was measured over."""
    (motion,) = re.findall(r"^motion +[0-9]+ cycles.*$", printed, re.MULTILINE)
    score = printed.splitlines()[-1]
    assert score.startswith("rotation drift θ̄ = ")
    return score, motion
