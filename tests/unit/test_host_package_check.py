"""Whatever hides one of our generic packages is named, also when it hides the one that holds the command."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import rotdrift
from tests.waiting import HANG_S

ROOT = Path(rotdrift.__file__).resolve().parent


def start(folder):
    """Start the command as the console script does, with a folder first on the path."""
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    code = "import sys; from rotdrift import main; sys.exit(main(['--version']))"
    return subprocess.run(
        [sys.executable, "-P", "-c", code],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=HANG_S,
    )


@pytest.mark.parametrize("name", sorted(rotdrift.PACKAGES))
@pytest.mark.parametrize("kind", ["module", "package"])
def test_a_module_or_package_that_hides_ours_is_named(tmp_path, name, kind):
    hiding = tmp_path / (f"{name}.py" if kind == "module" else f"{name}/__init__.py")
    hiding.parent.mkdir(exist_ok=True)
    hiding.touch()
    done = start(tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"rotdrift: {hiding} hides our package {name}")
    assert done.stderr.count("\n") == 1


def test_nothing_hides_them_here(tmp_path):
    assert rotdrift.hidden_package(ROOT) is None
    assert start(tmp_path).returncode == 0


def test_packages_of_another_copy_are_not_ours(tmp_path):
    assert "hides our package analysis" in rotdrift.hidden_package(tmp_path)
