"""Which CAN tool wrote a file, by its first lines, without loading any driver."""

from __future__ import annotations

import re

CANDUMP_LINE = re.compile(
    r"\(\d{1,12}\.\d{1,9}\) \S{1,64} [0-9A-Fa-f]{3,8}#(R\d?|[0-9A-Fa-f]{0,16}|#[0-9A-Fa-f]{1,129})( [RT])?\s*$"
)
"""``(1700000000.123456) can0 183#0011223344556677``, as ``candump -l`` writes it."""

_CSV_HEAD = "timestamp,arbitration_id,extended,remote,error,dlc,data"
HEAD_BYTES = 4096
_LINES = 20


def can_log_kind(head: bytes) -> str | None:
    """Return the kind of a CAN log by its first ``HEAD_BYTES``: ``candump``, ``ASC``, ``CSV``, ``BLF``, or None."""
    if head.startswith(b"LOGG"):
        return "BLF"
    lines = [line.strip() for line in head[:HEAD_BYTES].decode("latin-1").splitlines() if line.strip()][:_LINES]
    if not lines:
        return None
    if lines[0] == _CSV_HEAD:
        return "CSV"
    if re.match(r"date \w{3} ", lines[0]) and any(line.startswith("base ") for line in lines[:5]):
        return "ASC"
    # A damaged line does not make it another format.
    return "candump" if sum(bool(CANDUMP_LINE.match(line)) for line in lines) * 2 > len(lines) else None
