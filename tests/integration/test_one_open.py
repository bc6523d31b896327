"""A recording is opened once for all who look at it, from the first sniff to the last row; seen by an audit hook."""

import json
import subprocess
import sys
from pathlib import Path

import can
import numpy as np
import pytest

from analysis.formats import read_series, write_series
from tests import reader_files as files

ROOT = Path(__file__).parents[2]
_SCRIPT = """
import json, sys
from pathlib import Path
opened = []
sys.addaudithook(lambda event, args: opened.append(str(args[0])) if event == "open" else None)
from host.errors import HostError
from host.results.any_file import score_recording
counts = {}
for name in sys.argv[1:]:
    opened.clear()
    try:
        score_recording(Path(name))
        said = ""
    except HostError as error:
        said = str(error)
    counts[Path(name).name] = opened.count(name), said
print(json.dumps(counts))
"""


def candump(path: Path) -> None:
    with can.CanutilsLogWriter(path) as log:
        for k in range(50):
            log(can.Message(timestamp=1.7e9 + k, arbitration_id=0x183, data=bytes(8), is_extended_id=False))


def ximu3(path: Path) -> None:
    rows = np.column_stack((np.arange(100) * 1e4, np.tile([1.0, 0.0, 0.0, 0.0], (100, 1))))
    path.write_text(files.rows_text(rows, "Timestamp (us),W,X,Y,Z"))


def bad_cell(path: Path) -> None:
    files.named(path)
    path.write_text(path.read_text().replace(",0.", ",zero.", 1))


def parquet(path: Path) -> None:
    pytest.importorskip("pyarrow")
    files.named(path.with_suffix(".csv"))
    write_series(read_series(path.with_suffix(".csv")), path, "parquet")


WRITERS = {
    "t42.csv": lambda path: files.t42(path, quaternion=True),
    "ndx.csv": files.ndx,
    "named.csv": files.named,
    "trajectory.tum": files.tum,
    "table.parquet": parquet,
    "Quaternion.csv": ximu3,
    "candump.log": candump,
    "bad.csv": bad_cell,
    "empty.csv": lambda path: path.write_bytes(b""),
}


def test_a_recording_is_opened_once(tmp_path):
    for name, write in WRITERS.items():
        write(tmp_path / name)
    command = [sys.executable, "-c", _SCRIPT, *(str(tmp_path / name) for name in WRITERS)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=120, check=True)
    counts = json.loads(done.stdout)
    assert {name: count for name, (count, _) in counts.items()} == dict.fromkeys(WRITERS, 1)
    assert "'zero." in counts["bad.csv"][1]
    assert "is empty" in counts["empty.csv"][1]
    assert "holds no samples" in counts["candump.log"][1]
