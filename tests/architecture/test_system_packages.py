"""The script that installs what tests need: one package that cannot be had costs nothing, and it always ends well."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.waiting import HANG_S

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="a shell script for Debian and Ubuntu")

SCRIPT = Path(__file__).parents[1] / "system-packages.sh"
NEEDED = ("date", "mktemp", "rm", "uname", "tail", "env", "timeout", "cat", "sleep", "sh")
APT = """#!/bin/sh
echo "$@" >> "{log}"
case "$*" in *octave*) echo "E: no octave"; exit 100;; esac
{then}
"""


@pytest.fixture
def run(tmp_path):
    programs = tmp_path / "bin"
    programs.mkdir()
    for name in NEEDED:
        (programs / name).symlink_to(shutil.which(name))
    write(programs / "id", "#!/bin/sh\necho 0\n")

    def run(apt="true", **environment):
        if apt is not None:
            write(programs / "apt-get", APT.format(log=tmp_path / "log", then=apt))
        done = subprocess.run(
            [str(SCRIPT)],
            env={"PATH": str(programs), "TMPDIR": str(tmp_path), **environment},
            capture_output=True,
            text=True,
            timeout=HANG_S,
        )
        calls = (tmp_path / "log").read_text().splitlines() if (tmp_path / "log").exists() else []
        return done, calls

    return run


def write(path, text):
    path.write_text(text)
    path.chmod(0o755)


def test_a_package_that_cannot_be_had_does_not_cost_the_others(run):
    done, calls = run()
    assert (done.returncode, done.stderr) == (0, "")
    assert "no octave (E: no octave); its tests will skip" in done.stdout
    alone = [call.split()[-1] for call in calls if " install " in call][1:]
    assert {"chromium", "octave"} <= set(alone)
    assert all(call.startswith("-qq -y --no-install-recommends") for call in calls)


def test_without_apt_it_says_so_and_ends_well(run):
    done, _ = run(apt=None)
    assert (done.returncode, done.stderr) == (0, "")
    assert "chromium" in done.stdout
    assert "will skip" in done.stdout


def test_it_ends_when_its_time_is_over(run):
    done, calls = run(apt="sleep 600", LIMIT_S="1")
    assert done.returncode == 0
    assert len(calls) <= 1  # for what comes after there is no time


def test_ci_calls_it_and_cannot_fail_by_it():
    text = (SCRIPT.parents[1] / ".ci" / "run").read_text()
    assert '[ "${CI:-}" != true ] || tests/system-packages.sh || true' in text
    assert os.access(SCRIPT, os.X_OK)
