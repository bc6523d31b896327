"""The command itself: light to start, one sentence for every failure, exit codes as agreed."""

import argparse
import ast
import errno
import importlib
import inspect
import json
import os
import re
import subprocess
import sys

import pytest

from host import cli
from host.commands import COMMANDS
from host.errors import FileError, LinkError, UsageError, unreadable, unwritable
from tests.command_line import BASE, environment, one_sentence, quick_scenario, rotdrift
from tests.recorded_trials import scenario, virtual_chunks, write_recording
from tests.waiting import HANG_S

HEAVY = {"numpy", "scipy", "matplotlib", "can", "serial", "rich", "mcap", "construct", "plotly", "jinja2", "msgspec"}


def test_help_imports_nothing_heavy():
    code = "import sys, rotdrift; rotdrift.main(['--help']); print(sorted(sys.modules), file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True, timeout=HANG_S
    )
    loaded = {name.strip("[]' ").split(".")[0] for name in done.stderr.split(",")}
    assert loaded & HEAVY == set()
    assert all(name in done.stdout for name in COMMANDS)


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_fits_a_terminal_of_80_columns(command, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert cli.main([command, "--help"] if command else ["--help"]) == 0
    assert [line for line in capsys.readouterr().out.splitlines() if len(line) > 80] == []


def test_every_command_has_its_help(capsys):
    for name in COMMANDS:
        assert cli.main([name, "--help"]) == 0
        assert "usage: rotdrift" in capsys.readouterr().out
    assert cli.main(["--version"]) == 0


@pytest.fixture
def run(capsys, monkeypatch, tmp_path):
    """Run the command in this process, in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def run_here(*arguments):
        code = cli.main([str(argument) for argument in arguments])
        output = capsys.readouterr()
        return subprocess.CompletedProcess(arguments, code, output.out, output.err)

    return run_here


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_reads_the_arguments_that_it_declares_and_no_others(name):
    parser = argparse.ArgumentParser()
    module = importlib.import_module(f"host.commands.{name}")
    module.add_parser(parser.add_subparsers())
    (command,) = parser._subparsers._group_actions[0].choices.values()
    declared = {action.dest for action in command._actions} - {"help"}
    read = {
        node.attr
        for node in ast.walk(ast.parse(inspect.getsource(module)))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "args"
    }
    assert read == declared


@pytest.mark.parametrize(
    "arguments",
    [
        ["nonsense"],
        ["score"],
        ["capture", "/dev/null", "--cycles", "0"],
        ["capture", "/dev/null", "--cycles", "many"],
        ["capture", "/dev/null", "--duration", "-1"],
        ["replay", "x.mcap", "--speed", "-1"],
        ["score", "--frob"],
        ["score", "x.csv", "--frob"],
    ],
)
def test_wrong_arguments_are_one_sentence(run, arguments):
    told = one_sentence(run(*arguments), 2)
    command = " ".join(["rotdrift", *(word for word in arguments[:1] if word in COMMANDS)])
    assert f"see `{command} --help`" in told


class Failing:
    def __init__(self, error):
        self._error = error

    def add_parser(self, subparsers: argparse._SubParsersAction):
        subparsers.add_parser("score")

    def run(self, _args):
        raise self._error


@pytest.mark.parametrize(
    ("error", "code", "told"),
    [
        (UsageError("that cannot be", "do this"), 2, "rotdrift: that cannot be: do this\n"),
        (LinkError("it is gone"), 3, "rotdrift: it is gone\n"),
        (FileError("no file\n\nhere", "look"), 4, "rotdrift: no file here: look\n"),
        (KeyboardInterrupt(), 130, "rotdrift: interrupted\n"),
    ],
)
def test_errors_become_a_sentence_and_a_code(monkeypatch, capsys, error, code, told):
    monkeypatch.setattr(cli, "COMMANDS", ("score",))
    monkeypatch.setattr(cli, "_command", lambda _: Failing(error))
    assert cli.main(["score"]) == code
    assert capsys.readouterr().err == told


def test_a_fault_of_our_own_is_admitted_and_debug_shows_it(monkeypatch, capsys):
    monkeypatch.setattr(cli, "COMMANDS", ("score",))
    monkeypatch.setattr(cli, "_command", lambda _: Failing(ZeroDivisionError("x")))
    assert cli.main(["score"]) == 70
    assert "Traceback" not in capsys.readouterr().err
    for arguments in (["--debug", "score"], ["score", "--debug"]):
        assert cli.main(arguments) == 70
        assert "Traceback" in capsys.readouterr().err


def test_a_reader_that_goes_away_is_no_failure(tmp_path):
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "wb") as gone:
        done = subprocess.run(
            [*BASE, "emulate", "--list"],
            stdout=gone,
            stderr=subprocess.PIPE,
            env=environment(),
            check=False,
            timeout=HANG_S,
        )
    assert done.returncode == 0
    assert done.stderr == b""


def test_an_output_that_knows_no_greek_is_no_failure(tmp_path):
    csv = tmp_path / "still.csv"
    csv.write_text("t,qw,qx,qy,qz\n" + "".join(f"{i / 100},1,0,0,0\n" for i in range(500)))
    done = rotdrift("score", csv, PYTHONUTF8="0", PYTHONIOENCODING="ascii")
    assert done.returncode == 1, done.stderr
    assert "no score" in done.stdout


# ---- bad input, one by one -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        (["capture", "/dev/ttyNOPE"], 3, "there is no port /dev/ttyNOPE"),
        (["capture", "bluetooth:x"], 2, "no kind of link called 'bluetooth'"),
        (["capture", "/dev/null", "--rate", "5000"], 2, "10 to 1000 Hz"),
        (["capture", "socket://127.0.0.1:1"], 3, "nothing answers at socket://127.0.0.1:1"),
        (["replay", "nothing.mcap"], 4, "there is no file nothing.mcap"),
        (["score", "nothing.csv"], 4, "there is no file nothing.csv"),
        (["score", "."], 4, "folder"),
        (["emulate", "--scenario", "nonsense", "--link", "tcp:0"], 2, "choose one of"),
        (["emulate"], 2, "--link"),
        (["emulate", "--link", "pty:", "--faults-from-stdin", "--until-stdin-ends"], 2, "give one of the two"),
        (["emulate", "--link", "smoke:signals"], 2, "no link 'smoke:signals'"),
        (["emulate", "--link", "tcp:0", "--duration", "0"], 2, "duration"),
        (["emulate", "--link", "tcp:0", "--seed", "-1"], 2, "-1 is not a valid seed: give --seed from 0"),
        (["demo", "--cycles", "1"], 2, "1 is not a valid number of cycles"),
        (["demo", "--scenario", "nonsense"], 2, "uneven-tempo, unplugged, or give the path"),
    ],
)
def test_bad_input_gets_one_sentence_and_the_code(run, tmp_path, arguments, code, told):
    assert told in one_sentence(run(*arguments), code)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("empty.mcap", b"", "is empty"),
        ("text.mcap", b"this is not a recording at all\n", "not a file known here"),
        ("empty.csv", b"", "is empty"),
        ("words.csv", b"t,qw,qx,qy,qz\n0,1,0,0,0\n0.01,one,0,0,0\n", "line 3"),
        ("inf.csv", b"t,qw,qx,qy,qz\n0,1,0,0,0\n0.01,inf,0,0,0\n", "line 3"),
        ("holes.csv", b"t,qw,qx,qy,qz\n0,,0,0,0\n0.01,nan,0,0,0\n", "no row holds an orientation"),
        ("norm.csv", b"t,qw,qx,qy,qz\n0,1,0,0,0\n0.01,3,0,0,0\n", "norm"),
    ],
)
def test_files_that_cannot_be_scored_are_said(run, tmp_path, name, content, told):
    (tmp_path / name).write_bytes(content)
    assert told in one_sentence(run("score", name), 4)


def test_a_file_that_is_no_recording_is_not_replayed(run, tmp_path):
    (tmp_path / "text.mcap").write_text("hello")
    assert "is not a recording" in one_sentence(run("replay", "text.mcap"), 4)


def test_a_still_object_is_not_valid_and_says_so_in_json_too(run, tmp_path):
    csv = tmp_path / "still.csv"
    csv.write_text("t,qw,qx,qy,qz\n" + "".join(f"{i / 100},1,0,0,0\n" for i in range(500)))
    done = run("score", csv, "--json")
    assert done.returncode == 1
    result = json.loads(done.stdout)
    assert result["theta_bar_deg"] is None
    assert result["valid"] is False
    assert result["reasons"]
    assert {"axis", "n_endpoints", "endpoints", "steps_deg", "period_s", "warnings", "losses"} <= set(result)


def test_a_byte_file_in_virtual_time_takes_seconds(run, tmp_path):
    scenario = quick_scenario(tmp_path, cycles=100)
    done = run("emulate", "--scenario", scenario, "--link", "file:bytes.bin", "--truth", "t.json")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "bytes.bin").stat().st_size > 100_000
    assert json.loads((tmp_path / "t.json").read_text())["complete"]
    again = run("emulate", "--scenario", scenario, "--link", "file:bytes.bin")
    assert "exists" in one_sentence(again, 4)
    again = run("emulate", "--scenario", scenario, "--link", "file:more.bin", "--truth", "t.json")
    assert one_sentence(again, 4).startswith("rotdrift: t.json exists already: give another name with --truth")
    assert not (tmp_path / "more.bin").exists()


def test_the_list_of_scenarios_has_a_line_each(run):
    done = run("emulate", "--list")
    assert done.returncode == 0
    assert "default" in done.stdout
    assert all(len(line.split()) > 3 for line in done.stdout.strip().splitlines())


def test_ports_is_never_an_error(run):
    assert run("ports").returncode == 0
    assert isinstance(json.loads(run("ports", "--json").stdout), list)


def test_fewer_than_three_cycles_are_not_valid_and_say_so(run, tmp_path):
    chunks, _ = virtual_chunks(scenario("ideal", motion={"cycles": 3}))
    write_recording(tmp_path / "short.mcap", chunks)
    done = run("score", "short.mcap")
    assert done.returncode == 1
    assert "no score: fewer than 3 cycles" in done.stdout
    assert done.stderr == ""


def test_a_recording_without_samples_is_not_valid(run, tmp_path):
    write_recording(tmp_path / "empty.mcap", [])
    done = run("score", "empty.mcap", "--json")
    assert done.returncode == 1
    assert "too short: 0 samples" in json.loads(done.stdout)["reasons"]


@pytest.mark.parametrize("size", [8, 60])
def test_a_recording_cut_in_its_header_is_one_sentence(run, tmp_path, size):
    path = write_recording(tmp_path / "cut.mcap", [])
    path.write_bytes(path.read_bytes()[:size])
    for command in ("score", "replay"):
        told = one_sentence(run(command, "cut.mcap"), 4)
        assert re.search(r"cut\.mcap .*: (copy it again|give the|score a bag)", told)


def test_the_window_of_a_score_can_be_given(run, tmp_path):
    chunks, truth = virtual_chunks(scenario("ideal", motion={"cycles": 8}))
    write_recording(tmp_path / "trial.mcap", chunks)
    times_s = [point["time_s"] for point in truth["endpoints"]]
    done = run("score", "trial.mcap", "--from", times_s[1] - 1, "--to", times_s[6] + 1, "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["n_endpoints"] == 6
    assert result["window"]["kind"] == "from-to"
    numbers = ",".join(str(point["sequence"]) for point in truth["endpoints"][:5])
    done = run("score", "trial.mcap", "--endpoints", numbers, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["n_endpoints"] == 5
    assert "holds nothing" in one_sentence(run("score", "trial.mcap", "--from", "900", "--to", "901"), 2)
    assert "give one of them" in one_sentence(run("score", "trial.mcap", "--to", "9", "--endpoints", "1,2,3,4"), 2)


@pytest.mark.parametrize("command", ["score", "replay", "convert", "report", "compare"])
def test_a_folder_or_nothing_in_place_of_a_file(run, tmp_path, command):
    (tmp_path / "folder.mcap").mkdir()
    needed = {"convert": ["out.csv"], "report": ["--out", "x"], "compare": ["--out", "x.csv"]}.get(command, [])
    for name in ("folder.mcap", "none.mcap"):
        done = run(command, name, *needed)
        told = one_sentence(done, 2 if name == "folder.mcap" and command in {"report", "compare"} else 4)
        assert name in told
        assert "errno" not in told.lower()
        assert ": " in told.removeprefix("rotdrift: "), "a remedy follows"


@pytest.mark.parametrize(
    ("number", "told"),
    [
        (errno.ENOENT, "there is no file x: check the path"),
        (errno.EISDIR, "x is a folder: give a file in it"),
        (errno.EACCES, "x cannot be read (permission denied): check the file's permissions"),
        (errno.EIO, "x cannot be read (input/output error): check the disk"),
    ],
)
def test_what_the_system_refuses_is_a_sentence_with_a_remedy(number, told):
    assert str(unreadable("x", OSError(number, os.strerror(number)))) == told


@pytest.mark.parametrize(
    "arguments",
    [
        ["score", "LONG"],
        ["verify", "LONG"],
        ["compare", "LONG", "--out", "x.csv"],
        ["baseline", "LONG"],
        ["report", "x.mcap", "--out", "LONG"],
        ["emulate", "--link", "tcp:0", "--truth", "LONG"],
        ["capture", "replay:x.mcap", "--out", "LONG"],
    ],
    ids=lambda arguments: arguments[0],
)
def test_a_name_too_long_for_the_system_is_one_sentence(run, arguments):
    told = one_sentence(run(*("a" * 5000 if word == "LONG" else word for word in arguments)), 4)
    assert len(told) < 400


@pytest.mark.parametrize("name", [".", "/"])
def test_a_report_of_what_has_no_name(run, name):
    assert "name the recording" in one_sentence(run("report", name, "--out", "x.zip"), 2)


@pytest.mark.parametrize("command", [["score", "x.csv"], ["report", "x.csv", "--out", "x.zip"]])
def test_a_window_and_end_points_at_once_are_refused(run, command):
    assert "both choose what to score" in one_sentence(run(*command, "--endpoints", "1,2,3,4", "--from", "2"), 2)


def test_a_full_disk_wants_room():
    assert "free some space" in str(unwritable("x", OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))))
    assert (
        str(unwritable("x", OSError(errno.EROFS, "Read-only"))) == "x cannot be written (read-only): give another place"
    )
