"""Results that must not change by themselves: those of the authors' recordings and of twelve emulated trials.

``python -m tests.golden_results`` writes ``tests/golden/`` again; the difference is to be read like any change of a
result. ``python -m tests.golden_results --exact`` compares to the last bit, on a machine like the one that wrote them.
"""

import contextlib
import dataclasses
import gzip
import io
import json
import math
import os
import sys
import tempfile
import threading
import zipfile
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # how sums are split over threads changes their last digits

from firmware_protocol.can.frames import pack_frames
from host.capture.playback import play, recorded_actions, recorded_commands
from host.cli import main
from host.links.transport import FrameChunk
from host.recording import format as fmt
from host.recording.replay_link import ReplayTransport
from host.recording.writer import RecordingWriter
from host.screen.screens import QuietScreen
from host.trial.live import Trial
from host.trial.operator import OperatorAction
from tests.can_traffic import object_at
from tests.emulated_packets import trial_packets
from tests.faulty_trials import faulty_chunks
from tests.recorded_trials import MONOTONIC_NS, WALL_NS, scenario

FOLDER = Path(__file__).parent / "golden"
RECORDINGS = Path(os.environ.get("ROTDRIFT_RECORDINGS", Path(__file__).parents[2] / "shared" / "recordings"))
SERIAL_CYCLES = {
    "default": 6,
    "bad-cable": 6,
    "clock-wrap": 6,
    "lossy": 6,
    "mute": 5,
    "reset": 9,
    "slip": 8,
    "troubled": 12,
    "two-hump": 6,
    "unplugged": 7,
}
"""Scenario -> cycles of its motion, so that its faults come within it."""
CAN = {"can-classic": False, "can-fd": True}
EMULATED = (*SERIAL_CYCLES, *CAN)
SUBMITTED = "slip"
TABLES = ("steps.csv", "endpoints.csv", "summary.csv")
OF_THE_MACHINE = {"rotdrift_version", "made_with", "raw"}
"""Keys whose values depend on versions, or on a recording that names its system."""
FRAME_NS = 5_000_000


def emulated_recording(name, folder):
    """Write the recording of an emulated trial, as a capture does; return its path."""
    path = folder / f"{name}.mcap"
    writer = RecordingWriter(path, "memory:", WALL_NS, MONOTONIC_NS, {"cycles": 10})
    for chunk in _can_chunks(CAN[name]) if name in CAN else faulty_chunks(_scenario(name))[0]:
        writer.add_received(chunk)
    for action in _actions(name):
        writer.add_values(fmt.ACTION, action.values(), MONOTONIC_NS)
    writer.close()
    return path


def _scenario(name):
    return scenario(name, motion={"cycles": SERIAL_CYCLES[name]})


def _can_chunks(fd):
    """Frames of a trial with every 50th sample lost and some out of place, four frames a read."""
    end = object_at(fd=fd)
    frames = end.encode(trial_packets("fast", 20.0))
    kept = [frame for k, frame in enumerate(frames) if k % 50 != 20 and not 900 < k < 1000]
    timed = [dataclasses.replace(frame, host_time_ns=MONOTONIC_NS + k * FRAME_NS) for k, frame in enumerate(kept)]
    return [
        FrameChunk(pack_frames(timed[start : start + 4]), timed[min(start + 3, len(timed) - 1)].host_time_ns)
        for start in range(0, len(timed), 4)
    ]


def _actions(name):
    if name != "slip":
        return ()
    return (
        OperatorAction("window-start", 8.0),
        OperatorAction("note", 12.0, "the hand was touched"),
        OperatorAction("exclude", 21.0, "slipped", 17.45, 22.45),
    )


def result_of(*arguments):
    """What ``rotdrift score --json`` prints; None where it refuses."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(io.StringIO()):
        code = main(["score", *map(str, arguments), "--json"])
    return {"code": code, "result": json.loads(printed.getvalue()) if printed.getvalue() else None}


def submission_of(path, folder):
    """The values in a submission, file by file, and the names of all its files."""
    archive = folder / "submission.zip"
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        code = main(["report", str(path), "--out", str(archive)])
    with zipfile.ZipFile(archive) as members:
        texts = {name: members.read(name).decode() for name in members.namelist() if name.endswith((*TABLES, ".json"))}
        values = {name: json.loads(text) if name.endswith(".json") else _cells(text) for name, text in texts.items()}
        return {"code": code, "files": sorted(members.namelist()), "values": values}


def _cells(table):
    return [[_number(cell) for cell in line.split(",")] for line in table.splitlines()]


def _number(cell):
    try:
        return float(cell)
    except ValueError:
        return cell


def live_state(path):
    """The last picture of a replay, as plain values."""
    state = play(
        ReplayTransport(path),
        Trial(),
        QuietScreen(),
        threading.Event(),
        actions=recorded_actions(path),
        commands=recorded_commands(path),
    )
    return dataclasses.asdict(state)


def results_of_emulated(name):
    with tempfile.TemporaryDirectory() as folder:
        path = emulated_recording(name, Path(folder))
        results = {"score": result_of(path), "published": result_of(path, "--as-published", "--ignore-actions")}
        if name == SUBMITTED:
            results["submission"] = submission_of(path, Path(folder))
        return _plain({**results, "live": live_state(path)}, folder)


def recordings():
    return sorted(RECORDINGS.glob("*/*.csv"))


def results_of_recording(path):
    results = {"score": result_of(path), "published": result_of(path, "--as-published")}
    known = json.loads((RECORDINGS / "endpoints.json").read_text())["recordings"].get(path.name)
    if known:
        results["rows"] = result_of(path, "--endpoints", ",".join(map(str, known["endpoints_row"])))
    return _plain(results, str(path.parent))


def _plain(value, folder):
    """Plain JSON; paths of this machine are left out."""
    text = json.dumps(value, default=str).replace(f"{folder}{os.sep}", "")
    return json.loads(text)


def differences(expected, found, relative=0.0, where=""):
    """Where two results differ: a key that is gone or another value. New keys are no difference."""
    if isinstance(expected, dict) and isinstance(found, dict):
        for key, value in expected.items():
            if key not in found:
                yield f"{where}.{key} is gone"
            elif key not in OF_THE_MACHINE:
                yield from differences(value, found[key], relative, f"{where}.{key}")
    elif isinstance(expected, list) and isinstance(found, list) and len(expected) == len(found):
        for k, (one, other) in enumerate(zip(expected, found, strict=True)):
            yield from differences(one, other, relative, f"{where}[{k}]")
    elif isinstance(expected, float) and isinstance(found, float | int) and relative:
        if not (math.isclose(expected, found, rel_tol=relative, abs_tol=relative) or expected != expected):
            yield f"{where}: {expected!r} became {found!r}"
    elif expected != found and not (expected != expected and found != found):
        yield f"{where}: {expected!r} became {found!r}"


def stored(name):
    path = FOLDER / f"{name}.json.gz"
    return json.loads(gzip.decompress(path.read_bytes())) if path.exists() else None


def all_results():
    for name in EMULATED:
        yield name, results_of_emulated(name)
    for path in recordings():
        yield path.stem, results_of_recording(path)


def _main(arguments):
    changed = 0
    if arguments not in ([], ["--exact"]):
        print(__doc__)
        return 2
    for name, results in all_results():
        if arguments:
            found = list(differences(stored(name), results))
            changed += len(found)
            print(name, *(found[:20] or ["equal"]), sep="\n  ")
        else:
            FOLDER.mkdir(exist_ok=True)
            text = json.dumps(results, separators=(",", ":"), ensure_ascii=False)
            (FOLDER / f"{name}.json.gz").write_bytes(gzip.compress(text.encode(), 9, mtime=0))
    return min(changed, 1)


if __name__ == "__main__":
    sys.exit(_main(sys.argv[1:]))
