"""Kernel modules of the user-mode kernel, loaded without kmod."""

from __future__ import annotations

import ctypes
import os
from pathlib import Path

FINIT_MODULE = 313  # x86-64


def insert(*names: str) -> None:
    """Load kernel modules, dependencies first, without kmod."""
    libc = ctypes.CDLL(None, use_errno=True)
    for name in names:
        path = next(Path("/usr/lib/uml/modules").glob(f"{os.uname().release}/**/{name}.ko"))
        with path.open("rb") as file:
            if libc.syscall(FINIT_MODULE, file.fileno(), b"", 0) and ctypes.get_errno() != 17:
                raise OSError(ctypes.get_errno(), f"insmod {name}")
