"""``python -m tests.mutation``: change the program in one place at a time; a test must notice, or a reason be given.

python -m tests.mutation                 every group of groups.toml
python -m tests.mutation score framing   some
python -m tests.mutation ledger --minutes 30
python -m tests.mutation ledger --report  only what the last run found

The work is done in copies of the tree under ``.mutation``; a run that was ended goes on where it was, as long as the
tree is the same. The reasons stand in explained.toml, by the line before and after the change. Exit code 1: a change
that no test notices has no reason there.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tomllib
from collections import Counter
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
COPIES = ROOT / ".mutation"
GROUPS = tomllib.loads((HERE / "groups.toml").read_text(encoding="utf-8"))
PACKAGES = ("analysis", "emulator", "firmware_protocol", "host")
KILLED, LEFT = "killed", ("survived", "no tests")
MUTMUT = [sys.executable, "-m", "mutmut"]


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__.splitlines()[0])
    parser.add_argument("groups", nargs="*", choices=[*GROUPS, []], help="default: all")
    parser.add_argument("--minutes", type=float, default=60.0, help="of each group, at most")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--report", action="store_true", help="do not run anything")
    args = parser.parse_args()
    unexplained = 0
    for name in args.groups or GROUPS:
        if not args.report:
            run(name, args.minutes, args.processes)
        unexplained += report(name)
    return 1 if unexplained else 0


def run(name: str, minutes: float, processes: int) -> None:
    """Run mutmut in a copy of the tree; what it was through with stays."""
    place = COPIES / name
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, check=True, timeout=60,
    )  # fmt: skip
    for file in listed.stdout.decode().split("\0"):
        source, target = ROOT / file, place / file
        if file and source.is_file() and not (target.is_file() and target.read_bytes() == source.read_bytes()):
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, target)
    (place / "setup.cfg").write_text(settings(name), encoding="utf-8")
    with (place / "run.log").open("w", encoding="utf-8") as log:  # it redraws its line without end
        command = [*MUTMUT, "run", "--max-children", str(processes)]
        try:
            subprocess.run(command, cwd=place, stdout=log, stderr=log, check=False, timeout=60 * minutes)
        except subprocess.TimeoutExpired:
            print(f"{name}: ended after {minutes:g} minutes; run it again to go on", flush=True)


def settings(name: str) -> str:
    """Return mutmut's settings for a group."""
    group = GROUPS[name]
    lists = {
        "source_paths": PACKAGES,
        "only_mutate": group["modules"],
        "pytest_add_cli_args": [
            "-q",
            "-p",
            "no:cacheprovider",
            *(f"--deselect={it}" for it in group.get("leave_out", ())),
        ],
        "pytest_add_cli_args_test_selection": group["tests"],
        "also_copy": ("rotdrift.py", "docs"),
    }
    lines = [f"{key}=\n    " + "\n    ".join(values) for key, values in lists.items()]
    # Nothing here is judged by how fast it is: a mutant is only ended when it takes many times as long.
    plain = [
        "use_git_change_detection=false",
        "track_dependencies=false",
        "timeout_multiplier=15",
        "timeout_constant=5",
    ]
    return "\n".join(["[mutmut]", *lines, *plain, ""])


def report(name: str) -> int:
    """Print what became of the mutants of a group; return how many are left without a reason."""
    place = COPIES / name
    done = subprocess.run(
        [*MUTMUT, "results", "--all", "true"], cwd=place, capture_output=True, text=True, check=False, timeout=300
    )
    found = re.findall(r"^\s*(\S+): (.+)$", done.stdout, re.MULTILINE)
    if not found:
        sys.exit(f"{name}: nothing was run\n{done.stderr}")
    explained = tomllib.loads((HERE / "explained.toml").read_text(encoding="utf-8"))
    reasons = {(change["function"], change["from"], change["to"]) for change in explained.get(name, ())}
    counts: Counter[str] = Counter(status for _, status in found)
    left = [(mutant, change_of(place, mutant)) for mutant, status in found if status in LEFT]
    open_ones = [(mutant, change) for mutant, change in left if change not in reasons]
    print(
        f"{name}: {len(found)} mutants, {counts[KILLED]} killed, {len(left)} left, "
        f"{len(left) - len(open_ones)} of these explained, {len(found) - counts[KILLED] - len(left)} others",
        flush=True,
    )
    for mutant, (_, before, after) in open_ones:
        print(f"  {mutant}\n    - {before}\n    + {after}", flush=True)
    return len(open_ones)


def change_of(place: Path, mutant: str) -> tuple[str, str, str]:
    """Return the function that a mutant changes, and the line before and after."""
    done = subprocess.run(
        [*MUTMUT, "show", mutant], cwd=place, capture_output=True, text=True, check=False, timeout=120
    )
    lines = [line for line in done.stdout.splitlines() if line[:1] in "+-" and line[:3] not in ("+++", "---")]
    before, after = (" ".join(line[1:].strip() for line in lines if line[0] == sign) for sign in "-+")
    function = re.sub(r"__mutmut_\d+$", "", mutant).rpartition(".")[2]
    return re.sub(r"^x_|^xǁ", "", function).replace("ǁ", "."), before, after


if __name__ == "__main__":
    sys.exit(main())
