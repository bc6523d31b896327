"""Wheel and sdist are the same bytes wherever and whenever they are built from the same sources."""

import hashlib
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from importlib.metadata import version
from pathlib import Path

import pytest
from packaging.version import Version

from tests.waiting import HANG_S

ROOT = Path(__file__).resolve().parents[2]
LEFT_OUT = shutil.ignore_patterns(
    ".*", "*.egg-info", "build", "dist", "__pycache__", "tests", "docs", "benchmarks", "findings"
)
EPOCH = 1_700_000_000
BUILD = "import sys; sys.path.insert(0, 'release'); import backend; backend.build_{}(sys.argv[1])"


def setuptools_is_missing():
    """Return why nothing can be built here; empty where it can."""
    try:
        found = Version(version("setuptools"))
    except Exception:  # noqa: BLE001 - not installed, or not readable
        return "setuptools is not installed: make test sets it up"
    return "" if found >= Version("77") else f"setuptools {found} is older than the 77 that pyproject.toml asks for"


def built(folder, umask, age_s):
    """Build both from a copy whose files have another age and other rights; return name and digest of each."""
    shutil.copytree(ROOT, folder / "sources", ignore=LEFT_OUT, copy_function=shutil.copyfile)
    for path in folder.rglob("*"):
        path.chmod((0o777 if path.is_dir() else 0o666) & ~umask)
        os.utime(path, (EPOCH + age_s, EPOCH + age_s))
    for what in ("wheel", "sdist"):
        done = subprocess.run(
            [sys.executable, "-c", BUILD.format(what), str(folder)],
            cwd=folder / "sources",
            env=os.environ | {"SOURCE_DATE_EPOCH": str(EPOCH), "TZ": f"X{age_s // 3600 % 12}"},
            capture_output=True,
            text=True,
            timeout=HANG_S,
            umask=umask,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
    return {path.name: path for path in folder.iterdir() if path.is_file()}


@pytest.fixture(scope="module")
def archives(tmp_path_factory):
    reason = setuptools_is_missing()
    if reason:
        pytest.skip(reason)
    return [built(tmp_path_factory.mktemp("built"), umask, age_s) for umask, age_s in ((0o022, 0), (0o077, 5 * 3600))]


@pytest.mark.skipif(sys.platform == "win32", reason="file modes of POSIX")
def test_two_builds_are_the_same_bytes(archives):
    first, second = (
        {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in each.items()} for each in archives
    )
    assert first == second
    assert sorted(name.rpartition(".")[2] for name in first) == ["gz", "whl"]


def test_both_hold_the_whole_program(archives):
    wheel, sdist = (next(path for name, path in archives[0].items() if name.endswith(end)) for end in (".whl", ".gz"))
    with zipfile.ZipFile(wheel) as opened:
        packed = {name for name in opened.namelist() if ".dist-info/" not in name}
        assert opened.testzip() is None
    packages = ("analysis", "emulator", "firmware_protocol", "host")
    sources = {
        path.relative_to(ROOT).as_posix()
        for package in packages
        for path in (ROOT / package).rglob("*")
        if path.is_file()
        and "__pycache__" not in path.parts
        and path.parts[len(ROOT.parts) : len(ROOT.parts) + 2] != ("firmware_protocol", "c")
    }
    assert packed == sources | {"rotdrift.py"}
    with tarfile.open(sdist) as opened:
        names = {name.partition("/")[2] for name in opened.getnames()}
        assert {entry.mtime for entry in opened.getmembers()} == {EPOCH}
        assert {(entry.uid, entry.gid, entry.uname) for entry in opened.getmembers()} == {(0, 0, "")}
    assert sources | {"rotdrift.py", "pyproject.toml", "release/backend.py", "README.md", "LICENSE"} <= names
