"""Which CAN tool wrote a file, by its first lines, without loading any driver."""

from __future__ import annotations

import re
from pathlib import Path

CANDUMP_LINE = re.compile(
    r"\(\d{1,12}\.\d{1,9}\) \S{1,64} [0-9A-Fa-f]{3,8}#(R\d?|[0-9A-Fa-f]{0,16}|#[0-9A-Fa-f]{1,129})( [RT])?\s*$"
)
"""``(1700000000.123456) can0 183#0011223344556677``, as ``candump -l`` writes it."""

_CSV_HEAD = "timestamp,arbitration_id,extended,remote,error,dlc,data"
_HEAD_BYTES = 4096
_LINES = 20


def can_log_kind(path: Path) -> str | None:
    """Return the kind of a CAN log: ``candump``, ``ASC``, ``CSV`` or ``BLF``; None for any other or unreadable file."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError:
        return None
    if head.startswith(b"LOGG"):
        return "BLF"
    lines = [line.strip() for line in head.decode("latin-1").splitlines() if line.strip()][:_LINES]
    if not lines:
        return None
    if lines[0] == _CSV_HEAD:
        return "CSV"
    if re.match(r"date \w{3} ", lines[0]) and any(line.startswith("base ") for line in lines[:5]):
        return "ASC"
    # A damaged line does not make it another format.
    return "candump" if sum(bool(CANDUMP_LINE.match(line)) for line in lines) * 2 > len(lines) else None
