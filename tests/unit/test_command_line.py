"""What stands before every command: help, guesses at what was meant, defaults of user and project, completion."""

import os
import subprocess
import sys

import pytest

from host import cli
from host.command_line.configuration import DEFAULTS_OF, SETTINGS
from host.commands import COMMANDS
from tests.command_line import BASE, environment, one_sentence
from tests.waiting import HANG_S


@pytest.fixture
def run(capsys, monkeypatch, tmp_path):
    """Run the command in this process, in an empty folder, with an empty folder of its user."""
    home = tmp_path / "home"
    home.mkdir()
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    for name in ("HOME", "USERPROFILE", "APPDATA", "LOCALAPPDATA"):
        monkeypatch.setenv(name, str(home))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)

    def run_here(*arguments):
        code = cli.main([str(argument) for argument in arguments])
        output = capsys.readouterr()
        return subprocess.CompletedProcess(arguments, code, output.out, output.err)

    return run_here


def test_alone_and_with_help_it_shows_its_commands(run):
    alone, asked = run(), run("help")
    assert (alone.returncode, asked.returncode) == (0, 0)
    assert alone.stdout == asked.stdout == run("--help").stdout
    assert all(f"\n    {name} " in alone.stdout for name in COMMANDS)
    assert run("help", "score").stdout == run("score", "--help").stdout
    assert run("-V").stdout == run("--version").stdout


@pytest.mark.parametrize(
    ("words", "guess"),
    [
        (["scor", "x.csv"], "there is no command 'scor' (did you mean score?)"),
        (["help", "captur"], "there is no command 'captur' (did you mean capture?)"),
        (["zzz"], "there is no command 'zzz'; see"),
        (["score", "x.csv", "--jsn"], "there is no option --jsn (did you mean --json?)"),
        (["score", "x.csv", "--xyzzy=3"], "there is no option --xyzzy; see"),
        (["replay", "x.mcap", "--theme", "drak"], "'drak' is not possible (did you mean dark?)"),
        (["replay", "x.mcap", "--theme", "zz"], "'zz' is not possible (choose auto or dark or light)"),
        (["verify", "a.zip", "b.zip"], "unexpected argument"),
        (["emulate", "--link", "pty:", "--scenario", "defualt"], "unknown scenario 'defualt': did you mean default?"),
        (["config", "lnk"], "there is no setting 'lnk': did you mean link?"),
    ],
)
def test_what_was_probably_meant_is_named(run, words, guess):
    assert guess in one_sentence(run(*words), 2)


def test_a_setting_of_the_project_counts_before_that_of_the_user(run, tmp_path):
    assert run("config", "theme", "light").returncode == 0
    assert run("config", "--project", "theme", "dark").returncode == 0
    shown = run("config", "theme").stdout.splitlines()[1].split()
    assert shown[:2] == ["theme", "dark"]
    assert shown[2].endswith("rotdrift.toml")
    (below := tmp_path / "work" / "a" / "b").mkdir(parents=True)
    os.chdir(below)
    assert run("config", "theme").stdout.split() == ["setting", "value", "from", *shown]
    assert run("config", "--project", "--unset", "theme").returncode == 0
    assert "light" in run("config", "theme").stdout
    assert run("config", "--unset", "theme").returncode == 0
    assert "auto" in run("config", "theme").stdout


def test_paths_are_those_of_the_folder_that_they_were_given_in(run, tmp_path):
    run("config", "--project", "folder", "trials")
    assert str(tmp_path / "work" / "trials") in run("config", "folder").stdout
    (tmp_path / "work" / "rotdrift.toml").write_text('hand = "cards/hand.toml"\n')
    assert str(tmp_path / "work" / "cards" / "hand.toml") in run("config", "hand").stdout


def test_a_default_is_what_a_command_gets_where_nothing_was_given(run, tmp_path):
    missing = tmp_path / "nothing_here"
    run("config", "link", missing)
    for command in ("capture", "baseline"):
        assert str(missing) in one_sentence(run(command), 3)
        assert "/another" in one_sentence(run(command, "/another"), 3)
    run("config", "--unset", "link")
    for command in ("capture", "baseline"):
        assert "LINK" in one_sentence(run(command), 2)


def test_every_default_is_of_an_argument_that_the_command_has():
    parser = cli.build_parser()
    (subparsers,) = (action for action in parser._actions if action.dest == "command")
    assert set(DEFAULTS_OF) == cli.CONFIGURED
    for command, arguments in DEFAULTS_OF.items():
        assert set(arguments) <= set(SETTINGS)
        assert set(arguments.values()) <= {action.dest for action in subparsers.choices[command]._actions}


@pytest.mark.parametrize(
    ("content", "code", "sentence"),
    [
        ("theme = 'drak'", 2, "theme is one of auto, dark, light, not 'drak'"),
        ("ascii = 3", 2, "ascii is true or false, not '3'"),
        ("link = 3", 2, "link is a text, not '3'"),
        ("lnik = '/dev/ttyACM0'", 2, "there is no setting 'lnik': did you mean link?"),
        ("theme = ", 4, "is not TOML"),
        ("\x00", 4, "is not TOML"),
        ("theme = '" + "x" * 200_000 + "'", 4, "is larger than 100000 bytes"),
    ],
)
def test_a_wrong_file_is_named_with_what_is_wrong(run, tmp_path, content, code, sentence):
    (tmp_path / "work" / "rotdrift.toml").write_text(content)
    for words in (["config"], ["capture", "/dev/null"]):
        text = one_sentence(run(*words), code)
        assert sentence in text
        assert "rotdrift.toml" in text


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_gets_its_code(run, shell):
    done = run("completion", shell)
    assert done.returncode == 0
    assert "rotdrift" in done.stdout


def completions(line, folder):
    """Return what bash would offer behind a line."""
    code = "import os, sys; os.dup2(1, 8); import rotdrift; rotdrift.main()"
    asked = environment() | {
        "_ARGCOMPLETE": "1", "_ARGCOMPLETE_SHELL": "bash", "COMP_LINE": line, "COMP_POINT": str(len(line)),
        "COMP_TYPE": "9", "_ARGCOMPLETE_IFS": "\n", "_ARGCOMPLETE_STDOUT_FILENAME": str(folder / "out"),
    }  # fmt: skip
    subprocess.run([sys.executable, "-c", code], env=asked, cwd=folder, timeout=HANG_S, check=True)
    return {word.strip() for word in (folder / "out").read_text().split("\n") if word.strip()}


def test_commands_options_scenarios_and_recordings_are_completed(tmp_path):
    (tmp_path / "trial.mcap").touch()
    (tmp_path / "thesis.docx").touch()
    assert completions("rotdrift sc", tmp_path) == {"score"}
    assert "--endpoints" in completions("rotdrift score --e", tmp_path)
    assert completions("rotdrift emulate --scenario heading", tmp_path) == {"heading-drift"}
    assert completions("rotdrift score t", tmp_path) == {"trial.mcap"}
    assert completions("rotdrift replay --theme d", tmp_path) == {"dark"}


def test_a_recording_gets_no_other_ending(run):
    assert "x.csv is not a name for a recording" in one_sentence(run("capture", "/dev/null", "--out", "x.csv"), 2)
    assert "/nope" in one_sentence(run("capture", "/nope", "--out", "run_0.5"), 3)


def test_a_link_that_fails_leaves_nothing_behind(run, tmp_path):
    one_sentence(run("capture", "/nope"), 3)
    assert list((tmp_path / "work").iterdir()) == []
    primary, secondary = os.openpty()
    try:
        one_sentence(run("capture", os.ttyname(secondary), "--out", "a/b/trial.mcap", "--duration", "0.3"), 3)
    finally:
        os.close(primary)
        os.close(secondary)
    assert list((tmp_path / "work").iterdir()) == []


def test_a_virtual_bus_is_said_to_end_in_its_process():
    done = subprocess.run(
        [*BASE, "emulate", "--link", "can:virtual:x", "--duration", "0.1"],
        capture_output=True, text=True, env=environment(), timeout=HANG_S, check=True,
    )  # fmt: skip
    assert "no other program can reach the object" in done.stderr
