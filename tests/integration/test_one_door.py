"""No text from outside drives the terminal, whatever it comes in by: arguments, names of files, what is in files.

The cases are made from the parsers, the formats and the exception classes, so that a new command, option, format or
error is walked as well.
"""

import argparse
import csv
import importlib
import io
import json
import logging
import pkgutil
import re
import sqlite3
import subprocess
import sys
import threading
import tomllib
import warnings
import zipfile
from pathlib import Path

import pytest
import tomli_w

import analysis
import emulator
import firmware_protocol
import host
from host import cli
from host.command_line.configuration import SETTINGS
from host.commands import COMMANDS
from host.errors import HostError
from tests.command_line import environment, quick_scenario, rotdrift_here
from tests.hostile_text import HOSTILE, NAME, NOT_UTF8, check_clean, faults
from tests.reader_files import named
from tests.recorded_trials import scenario, virtual_chunks, write_recording
from tests.small_recordings import chunks as small_chunks
from tests.waiting import HANG_S

POSIX = pytest.mark.skipif(sys.platform in {"win32", "darwin"}, reason="names there are Unicode without controls")
ROOT = Path(__file__).parents[2]


def run(*arguments, cwd="."):
    """Run the command; check all it prints, and that every line of an error is one of ours."""
    done = rotdrift_here(*arguments, cwd=cwd, XDG_CONFIG_HOME=str(Path(cwd).absolute()))  # not this person's defaults
    check_clean(done.stdout, done.stderr)
    if "--debug" not in arguments:
        assert all(line.startswith("rotdrift: ") for line in done.stderr.splitlines()), ascii(done.stderr)
    return done


def subparsers():
    action = next(a for a in cli.build_parser()._actions if isinstance(a, argparse._SubParsersAction))
    return action.choices


USUAL = {
    "demo": ["--scenario", "nonsense", "--cycles", "1"],
    "emulate": ["--link", "file:bytes.bin", "--duration", "0.05"],
    "capture": ["--reconnect", "0"],
}
"""What ends a command at once where nothing is hostile."""


def command_lines():
    """Every command with every argument hostile in turn: command, name of the argument, words."""
    for command, parser in subparsers().items():
        arguments = [action for action in parser._actions if action.dest not in {"help", "debug"}]
        positionals = [action for action in arguments if not action.option_strings]
        required = [action for action in arguments if action.option_strings and action.required]
        plain = [word for action in required for word in (action.option_strings[0], "out.csv")]
        places = ["none.csv" for _ in positionals]
        for number, action in enumerate(positionals):
            hostile = [*places[:number], HOSTILE, *places[number + 1 :]]
            yield command, action.dest, [*hostile, *plain, *USUAL.get(command, ())]
        for action in arguments:
            if not action.option_strings:
                continue
            words = [action.option_strings[0], *([] if action.nargs == 0 else [HOSTILE])]
            yield command, action.dest, [*places, *plain, *USUAL.get(command, ()), *words]
        yield command, "an unknown option", [*places, *plain, "--" + HOSTILE.replace(" ", "")]
    yield HOSTILE, "the command", []


LINES = list(command_lines())


def test_every_argument_of_every_command_is_walked():
    walked = {(command, name) for command, name, _ in LINES}
    for command, parser in subparsers().items():
        assert {(command, a.dest) for a in parser._actions if a.dest not in {"help", "debug"}} <= walked
    assert {command for command, _ in walked} >= set(COMMANDS)


@pytest.mark.parametrize("command", [*COMMANDS, HOSTILE], ids=lambda name: name if name in COMMANDS else "hostile")
def test_a_hostile_argument_is_shown_harmless(command, tmp_path, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO(HOSTILE))  # faults may be typed
    for name, _, words in LINES:
        if name == command and "--probe" not in words:
            for debug in ([], ["--debug"]):
                run(*debug, command, *words, cwd=tmp_path)


@pytest.mark.parametrize(
    "link", ["serial:{}", "can:{}", "can:socketcan:{}", "replay:{}", "serial:socket://{}:1", "{}:x"]
)
@pytest.mark.parametrize("command", ["capture", "doctor", "baseline"])
def test_a_hostile_link_is_shown_harmless(command, link, tmp_path):
    for debug in ([], ["--debug"]):
        run(*debug, command, link.format(HOSTILE.replace("/", "")), cwd=tmp_path)


# ---- names of files --------------------------------------------------------------------------------------------------


def csv_trial(path):
    named(path)


def recording(path):
    write_recording(path, small_chunks())


def damaged(path):
    recording(path)
    path.write_bytes(path.read_bytes()[:-40])


def archive(path):
    with zipfile.ZipFile(path, "w") as made:
        made.writestr(NAME, b"x")


CONTENTS = {
    "nothing": lambda path: path.write_bytes(b""),
    "words": lambda path: path.write_text("these are words\n"),
    "csv": csv_trial,
    "recording": recording,
    "damaged": damaged,
    "cards": lambda path: path.write_text('[hand]\nmodel = "x"\n'),
    "json": lambda path: path.write_text("{}"),
    "archive": archive,
    "a folder": lambda path: path.mkdir(),
}
SUFFIXES = {
    "csv": ".csv",
    "recording": ".mcap",
    "damaged": ".mcap",
    "cards": ".toml",
    "json": ".json",
    "archive": ".zip",
}
ON_FILES = (
    ("score", "FILE"), ("score", "FILE", "--json"), ("score", "FILE", "--csv"), ("score", "FILE", "--quiet"),
    ("score", "FILE", "FILE"),
    ("score", "c.csv", "--endpoints", "FILE"),
    ("score", "c.csv", "--baseline", "FILE"), ("score", "c.csv", "--plot", "FILE.nothing"),
    ("score", "c.csv", "--preceding", "FILE"), ("replay", "FILE", "--plain"), ("recover", "FILE", "NEW.mcap"),
    ("recover", "c.csv", "FILE"), ("verify", "FILE"), ("compare", "FILE"), ("compare", "FILE", "--out", "NEW.csv"),
    ("convert", "FILE", "NEW.csv"), ("convert", "c.csv", "NEW.tum"), ("convert", "c.csv", "FILE", "--to", "csv"),
    ("baseline", "FILE"), ("init", "--from", "FILE", "--card", "hand", "NEW"), ("init", "--from", "FILE", "FILE"),
    ("emulate", "--scenario", "FILE", "--link", "file:NEW", "--duration", "0.05"),
    ("emulate", "--link", "file:FILE", "--duration", "0.05"), ("report", "none.mcap", "--out", "FILE"),
    ("report", "FILE", "--out", "NEW.csv", "--cards", "FILE", "--endpoints", "1,2"),
    ("capture", "replay:FILE", "--out", "NEW.mcap"), ("capture", "replay:none", "--out", "FILE"),
    ("emulate", "--link", "file:x.bin", "--truth", "NEW", "--duration", "0.05"), ("doctor", "--folder", "FILE"),
)  # fmt: skip


@POSIX
@pytest.mark.parametrize("content", CONTENTS)
def test_a_hostile_name_of_a_file_is_shown_harmless(content, tmp_path):
    name = NOT_UTF8 + SUFFIXES.get(content, "")
    CONTENTS[content](tmp_path / name)
    csv_trial(tmp_path / "c.csv")
    for number, words in enumerate(ON_FILES):
        if content != "csv" and (words[0] in {"doctor", "emulate"} or words == ("score", "FILE", "FILE")):
            continue  # the same whatever is in the file; a pool of processes
        new = f"{number}{NOT_UTF8}"
        run(*(word.replace("FILE", name).replace("NEW", new) for word in words), cwd=tmp_path)


# ---- what is in files ------------------------------------------------------------------------------------------------


def hostile_tables(values):
    """Every table with one text or one key hostile in turn."""
    for key, value in values.items():
        if isinstance(value, dict):
            yield from ({**values, key: changed} for changed in hostile_tables(value))
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            yield from ({**values, key: [changed, *value[1:]]} for changed in hostile_tables(value[0]))
        yield {**values, key: HOSTILE}
        yield {name if name != key else HOSTILE: kept for name, kept in values.items()}


SEEDS = ROOT / "tests" / "fuzz" / "seeds"


def test_every_field_of_a_card_is_shown_harmless(tmp_path):
    full = tomllib.loads((SEEDS / "cards" / "full.toml").read_text(encoding="utf-8"))
    cases = list(hostile_tables(full))
    assert len(cases) > 60
    for number, values in enumerate(cases):
        (tmp_path / "card.toml").write_text(tomli_w.dumps(values), encoding="utf-8")
        run("init", "--from", "card.toml", f"cards{number}", cwd=tmp_path)


def test_every_key_of_a_scenario_is_shown_harmless(tmp_path):
    full = tomllib.loads((SEEDS / "scenario" / "full.toml").read_text(encoding="utf-8"))
    cases = list(hostile_tables(full))
    assert len(cases) >= 20
    for number, values in enumerate(cases):
        (tmp_path / "s.toml").write_text(tomli_w.dumps(values), encoding="utf-8")
        run("emulate", "--scenario", "s.toml", "--link", f"file:{number}.bin", "--duration", "0.01", cwd=tmp_path)


def test_every_default_of_a_project_is_shown_harmless(tmp_path):
    for values in (*({name: HOSTILE} for name in (*SETTINGS, HOSTILE)), {"link": [HOSTILE]}, {HOSTILE: {HOSTILE: 1}}):
        (tmp_path / "rotdrift.toml").write_text(tomli_w.dumps(values), encoding="utf-8")
        for words in (["config"], ["config", "link"], ["capture"], ["baseline"], ["report", "x", "--out", "y.zip"]):
            run(*words, cwd=tmp_path)
    (tmp_path / "rotdrift.toml").write_text(f"link = {HOSTILE}", encoding="utf-8")
    run("capture", cwd=tmp_path)


def test_every_column_and_cell_of_a_table_is_shown_harmless(tmp_path):
    named(tmp_path / "sound.csv", n=30)
    rows = list(csv.reader((tmp_path / "sound.csv").read_text().splitlines()))
    for row in range(2):
        for column in range(len(rows[0])):
            changed = [list(cells) for cells in rows]
            changed[row][column] = HOSTILE
            with (tmp_path / "t.csv").open("w", newline="", encoding="utf-8") as file:
                csv.writer(file).writerows(changed)
            for more in ([], ["--columns", "t=nothing,qw=w,qx=x,qy=y,qz=z"], ["--columns", f"t={HOSTILE}"]):
                run("score", "t.csv", *more, cwd=tmp_path)
                run("convert", "t.csv", "t.tum", *more, cwd=tmp_path)
                (tmp_path / "t.tum").unlink(missing_ok=True)


def test_every_value_of_a_result_is_shown_harmless_beside_others(tmp_path):
    chunks, _ = virtual_chunks(scenario("fast", motion={"cycles": 4}))
    write_recording(tmp_path / "trial.mcap", chunks)
    result = json.loads(run("score", "trial.mcap", "--json", cwd=tmp_path).stdout)
    strings = [key for key, value in result.items() if isinstance(value, str | list)]
    for key in strings:
        changed = {**result, key: [HOSTILE] if isinstance(result[key], list) else HOSTILE}
        (tmp_path / "r.json").write_text(json.dumps(changed))
        run("compare", "r.json", cwd=tmp_path)
    assert len(strings) > 5


def test_the_names_that_an_object_and_its_operator_give_are_shown_harmless(tmp_path):
    from firmware_protocol.codec import encode_packet
    from firmware_protocol.packets import Info
    from firmware_protocol.serial.framing import encode_frame
    from host.links.transport import Chunk
    from host.recording.writer import RecordingWriter

    chunks, _ = virtual_chunks(scenario("fast", motion={"cycles": 4}))
    packet = encode_packet(Info(device_id=1, boot_id=2, name="X" * 28)).replace(b"X" * 28, HOSTILE.encode()[:28])
    path = tmp_path / "t.mcap"
    writer = RecordingWriter(path, HOSTILE, 10**18, 10**9, {HOSTILE: HOSTILE})
    for chunk in [Chunk(encode_frame(packet), chunks[0].host_time_ns), *chunks]:
        writer.add_received(chunk)
    for kind in ("note", HOSTILE):
        writer.add_note(kind, HOSTILE, chunks[-1].host_time_ns)
    writer.close()
    for words in (
        ["score", path], ["score", path, "--json"], ["replay", path, "--plain"],
        ["recover", path, tmp_path / "new.mcap"], ["convert", path, tmp_path / "new.csv"],
        ["score", path, "--from", HOSTILE],
    ):  # fmt: skip
        run(*words)


def test_topics_and_frames_of_a_bag_are_shown_harmless(tmp_path):
    bags = pytest.importorskip("rosbags.rosbag2", reason="the extra rotdrift[ros] is not installed")
    from tests.unit import test_reader_bags as made

    del bags
    topic = "/" + re.sub(r"[\r\n]", "", HOSTILE)
    made.write(tmp_path / "bag", ["sensor_msgs/msg/Imu"] * 2, n=10)
    database = next((tmp_path / "bag").glob("*.db3"))
    from contextlib import closing

    with closing(sqlite3.connect(database)) as open_database, open_database:
        open_database.execute("UPDATE topics SET name = ? WHERE id = 1", (topic,))
    metadata = tmp_path / "bag" / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("name: /topic0", f"name: {json.dumps(topic)}"))
    for more in ([], ["--topic", "/topic1"], ["--topic", topic], ["--topic", HOSTILE]):
        run("score", "bag", *more, cwd=tmp_path)


def test_columns_of_parquet_are_shown_harmless(tmp_path):
    pyarrow = pytest.importorskip("pyarrow", reason="the extra rotdrift[parquet] is not installed")
    from pyarrow import parquet

    for wrong in range(5):
        names = [HOSTILE if k == wrong else name for k, name in enumerate(("t", "qw", "qx", "qy", "qz"))]
        table = pyarrow.table({name: [1.0, 2.0] if name != HOSTILE else ["a", "b"] for name in names})
        parquet.write_table(table, tmp_path / "t.parquet")
        for more in ([], ["--columns", f"t={HOSTILE}"], ["--columns", "t=none"]):
            run("score", "t.parquet", *more, cwd=tmp_path)


def test_lines_of_can_logs_are_shown_harmless(tmp_path):
    for text in (
        f"(1.0) {HOSTILE} 123#00\n", f"(1.0) can0 {HOSTILE}#00\n", f"(1.0) can0 123#{HOSTILE}\n",
        f"date {HOSTILE}\nbase hex\n1.0 1 123 Rx d 1 {HOSTILE}\n",
    ):  # fmt: skip
        for name in ("t.log", "t.asc"):
            (tmp_path / name).write_text(text, encoding="utf-8")
            run("score", name, cwd=tmp_path)


def test_what_verify_found_is_shown_harmless():
    from dataclasses import fields

    from host.commands.verify import _lines
    from host.output.lines import write_lines
    from host.submission.signature import SignatureFinding, Standing
    from host.submission.verification import Verification

    known = {"digest": HOSTILE, "n_files": 1, "n_trials": 1, "uncompared": {HOSTILE: HOSTILE}, "packing": HOSTILE}
    known |= {"signature": SignatureFinding(Standing.BAD, HOSTILE, HOSTILE, HOSTILE), "submission": None}
    values = {f.name: known.get(f.name, (HOSTILE,)) for f in fields(Verification) if f.init}
    out = io.StringIO()
    write_lines(_lines(Verification(**values)), out)
    check_clean(out.getvalue())


# ---- everything that can be raised -----------------------------------------------------------------------------------


OURS = {"analysis", "emulator", "firmware_protocol", "host"}


def exceptions():
    """Every exception class of ours, and those of the languages and libraries that a command may meet."""
    for package in (analysis, emulator, firmware_protocol, host):
        for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            if module.name != "host.screen.process":
                try:
                    importlib.import_module(module.name)
                except ModuleNotFoundError as error:  # of an extra that is not installed here
                    if (error.name or "").partition(".")[0] in OURS:
                        raise
    waiting, found = [Exception], set()
    while waiting:
        for child in waiting.pop().__subclasses__():
            if child not in found:
                found.add(child)
                waiting.append(child)
    return [kind for kind in found if kind.__module__.partition(".")[0] in {*OURS, "builtins"}]


class Failing:
    """A subcommand that does one thing."""

    def __init__(self, does):
        self._does = does

    def add_parser(self, subparsers):
        subparsers.add_parser("score")

    def run(self, _args):
        self._does()
        return 0


def run_failing(monkeypatch, does, *words):
    monkeypatch.setattr(cli, "COMMANDS", ("score",))
    monkeypatch.setattr(cli, "_command", lambda _: Failing(does))
    return run(*words, "score")


def made(kind):
    for arguments in (
        (HOSTILE,),
        (HOSTILE, HOSTILE),
        (HOSTILE, HOSTILE, (HOSTILE,)),
        (5, HOSTILE, HOSTILE),
        (ValueError(HOSTILE),),
        (),
    ):
        try:
            error = kind(*arguments)
            text = str(error)  # where the arguments do not fit, it may be none
        except (TypeError, ValueError):
            continue
        if HOSTILE in text or HOSTILE in repr(error):
            return error
    return None


def test_the_text_of_every_exception_is_shown_harmless(monkeypatch):
    walked = 0
    for kind in exceptions():
        error = made(kind)
        # The first is no failure, the reader has gone; the text of the other is not shown.
        if error is None or kind in {BrokenPipeError, MemoryError}:
            continue

        def does(error=error):
            raise error

        walked += 1
        assert "evil" in run_failing(monkeypatch, does).stderr
        run_failing(monkeypatch, does, "--debug")
    assert walked > 40
    assert {kind for kind in exceptions() if issubclass(kind, HostError) and made(kind) is None} == set()


def test_an_error_of_the_system_with_a_hostile_name(monkeypatch):
    def does():
        raise FileNotFoundError(2, HOSTILE, NOT_UTF8)

    assert "evil" in run_failing(monkeypatch, does).stderr


# ---- what prints without us ------------------------------------------------------------------------------------------


WITHIN_A_LINE = HOSTILE.replace("\r\n", "")
"""Lines that others print are theirs: only our own texts are held on one."""


def warn():
    sys.stderr.write(warnings.formatwarning(WITHIN_A_LINE, UserWarning, WITHIN_A_LINE, 1))  # as showwarning does


def log():
    logging.getLogger("a library").warning(WITHIN_A_LINE)


def write_by_hand():
    print(WITHIN_A_LINE)
    sys.stderr.writelines([WITHIN_A_LINE])


def raise_in_a_thread():
    def does():
        raise ValueError(WITHIN_A_LINE)

    before, threading.excepthook = threading.excepthook, threading.__excepthook__  # pytest has one of its own
    try:
        thread = threading.Thread(target=does)
        thread.start()
        thread.join(HANG_S)
    finally:
        threading.excepthook = before


@pytest.mark.parametrize("does", [warn, log, write_by_hand, raise_in_a_thread])
def test_what_libraries_print_is_shown_harmless(monkeypatch, does):
    monkeypatch.setattr(logging.root, "handlers", [])
    monkeypatch.setattr(cli, "COMMANDS", ("score",))
    monkeypatch.setattr(cli, "_command", lambda _: Failing(does))
    done = rotdrift_here("score")
    check_clean(done.stdout, done.stderr)
    assert "evil" in done.stdout + done.stderr


def test_a_process_prints_nothing_else_even_while_it_ends():
    """The streams stay in place: what is printed after the command has passed them, too. In the C locale, as well."""
    code = (
        "import atexit, os, sys, rotdrift; from tests.hostile_text import HOSTILE as text\n"
        "class Late:\n"
        "    def __del__(self): raise ValueError(text.replace('FAKE', ''))\n"
        "late = Late(); atexit.register(lambda: print(text.replace('FAKE', '')))\n"
        "sys.argv = ['rotdrift', 'score', os.fsdecode(text.encode())]; code = rotdrift.main(); del late; sys.exit(code)"
    )
    c_locale = environment(LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0")
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=c_locale, capture_output=True, timeout=HANG_S, check=False
    )
    assert done.returncode == 4
    for output in (done.stdout.decode("ascii"), done.stderr.decode("ascii")):
        check_clean(output)
        assert "evil" in output


# ---- our own colours -------------------------------------------------------------------------------------------------


def test_our_own_colours_stay_and_no_color_removes_them(tmp_path):
    from tests.hostile_text import OUR_STYLES

    chunks, _ = virtual_chunks(scenario("fast", motion={"cycles": 4}))
    write_recording(tmp_path / "trial.mcap", chunks)
    colour = {"FORCE_COLOR": "1", "TERM": "xterm-256color", "COLUMNS": "100"}
    done = rotdrift_here("score", "trial.mcap", cwd=tmp_path, **colour)
    assert OUR_STYLES.search(done.stdout)
    check_clean(OUR_STYLES.sub("", done.stdout))
    done = rotdrift_here("score", "trial.mcap", cwd=tmp_path, NO_COLOR="1", **colour)
    assert not re.search(r"\x1b\[[0-9;]*3[0-9]", done.stdout)
    assert "\x1b" not in rotdrift_here("score", "trial.mcap", cwd=tmp_path).stdout


def test_scenarios_are_real(tmp_path):
    """The file of a scenario that is walked is one that runs."""
    assert (
        run(
            "emulate", "--scenario", quick_scenario(tmp_path), "--link", "file:b", "--duration", "0.1", cwd=tmp_path
        ).returncode
        == 0
    )


def test_the_check_finds_what_is_left():
    assert faults("rotdrift: done\n\tand more θ̄\n") == []
    for bad in ("\x1b[31m", "\x07", "\x7f", "\x9b", "\r", "\u202e", "\u2066", "\u200f", "\u2028", "\ufeff", "\udcff"):
        assert faults(f"a{bad}b")
    assert faults("a\nFAKE: done") == ["FAKE: done"]


# ---- what devices and drivers report ---------------------------------------------------------------------------------


def hostile_ports():
    from serial.tools.list_ports_common import ListPortInfo

    port = ListPortInfo(f"/dev/tty{HOSTILE.replace('/', '')}")
    port.description = port.product = port.manufacturer = port.serial_number = HOSTILE
    port.vid, port.pid = 0x2341, 0x43
    return [port]


@pytest.mark.parametrize("words", ["ports", "ports --json", "doctor", "doctor --json", "capture serial:x"])
def test_names_of_devices_are_shown_harmless(words, tmp_path, monkeypatch):
    monkeypatch.setattr("host.links.serial.listing._list_ports.comports", hostile_ports)
    monkeypatch.setattr("can.detect_available_configs", lambda kinds: [{"interface": kinds[0], "channel": HOSTILE}])
    done = run(*words.split(), cwd=tmp_path)
    assert "evil" in done.stdout + done.stderr
    if "--json" in words:
        json.loads(done.stdout)


@pytest.mark.parametrize("kind", ["SerialException", "OSError", "ValueError"])
def test_messages_of_serial_drivers_are_shown_harmless(kind, tmp_path, monkeypatch):
    import serial

    error = {"SerialException": serial.SerialException, "OSError": OSError, "ValueError": ValueError}[kind]

    def fails(*_, **__):
        raise error(HOSTILE)

    monkeypatch.setattr("host.links.serial.port._serial_for_url", fails)
    for debug in ([], ["--debug"]):
        run(*debug, "capture", "serial:/dev/null", "--reconnect", "0", cwd=tmp_path)
        run(*debug, "doctor", "serial:/dev/null", cwd=tmp_path)


@pytest.mark.parametrize("kind", ["CanInitializationError", "CanOperationError", "OSError", "ImportError"])
def test_messages_of_can_drivers_are_shown_harmless(kind, tmp_path, monkeypatch):
    import can

    def fails(*_, **__):
        raise ({"OSError": OSError, "ImportError": ImportError}.get(kind) or getattr(can, kind))(HOSTILE)

    monkeypatch.setattr("can.Bus", fails)
    for interface in ("pcan", "kvaser", "virtual", "udp_multicast"):
        for debug in ([], ["--debug"]):
            link = f"can:{interface}:PCAN_USBBUS1?bitrate=500000"
            run(*debug, "capture", link, "--reconnect", "0", cwd=tmp_path)
