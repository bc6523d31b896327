"""Who holds a port open, where the system tells."""

from __future__ import annotations

import os
from pathlib import Path

from host.plain_text import plain

PROC = Path("/proc")


def port_owners(device: str, proc: Path = PROC) -> list[str]:
    """List the other processes that have a device open, as ``"minicom (process 4711)"``.

    Reads ``/proc/*/fd``; processes of other users are not visible without privilege, and other systems have no
    ``/proc``, so an empty list does not mean that nobody holds it.
    """
    owners = []
    try:
        target = os.path.realpath(device)
        processes = [entry for entry in proc.iterdir() if entry.name.isdigit() and entry.name != str(os.getpid())]
    except OSError:
        return []
    for process in sorted(processes, key=lambda entry: int(entry.name)):
        try:
            held = any(str(link.readlink()) == target for link in (process / "fd").iterdir())
            if held:
                owners.append(f"{_name(process)} (process {process.name})")
        except OSError:  # gone meanwhile, or another user's
            continue
    return owners


def _name(process: Path) -> str:
    arguments = (process / "cmdline").read_bytes().split(b"\0")
    words = [word.decode(errors="replace") for word in arguments if word]
    # `python3 /usr/bin/rotdrift capture …` is rotdrift to the person who typed it.
    if len(words) > 1 and Path(words[0]).name.startswith("python"):
        words = [word for word in words[1:] if not word.startswith("-")] or words
    name = Path(words[0]).name if words else (process / "comm").read_text(errors="replace")
    return plain(name, 60)
