"""Which CAN tool wrote a file, by its first lines, without loading any driver."""

from __future__ import annotations

import re

CANDUMP_LINE = re.compile(
    r"\(\d{1,12}\.\d{1,9}\) \S{1,64} [0-9A-Fa-f]{3,8}#(R\d?|[0-9A-Fa-f]{0,16}|#[0-9A-Fa-f]{1,129})( [RT])?\s*$"
)
"""``(1700000000.123456) can0 183#0011223344556677``, as ``candump -l`` writes it."""

SCREEN_LINE = re.compile(
    r"\s*(?:\((?P<time>\d{1,12}\.\d{1,9})\)\s+)?(?P<channel>[A-Za-z]\S{0,63})\s+(?:[RT]X\s+\S\s+\S\s+)?(?P<id>[0-9A-Fa-f]{3,8})"
    r"\s+\[(?P<length>\d{1,2})\]\s*(?P<data>(?:[0-9A-Fa-f]{2}(?:\s+|$))*)\s*(?:'.*')?$"
)
"""``  can0  183   [8]  00 11 22 33 44 55 66 77``, as ``candump`` prints it."""
CSV_HEAD = "timestamp,arbitration_id,extended,remote,error,dlc,data"
HEAD_BYTES = 4096
_LINES = 20


def can_log_kind(head: bytes) -> str | None:
    """Return the kind of a CAN log by its first ``HEAD_BYTES``: ``candump``, ``ASC``, ``CSV``, ``TRC``, …, or None."""
    if head.startswith(b"LOGG"):
        return "BLF"
    lines = [line.strip() for line in head[:HEAD_BYTES].decode("latin-1").splitlines() if line.strip()][:_LINES]
    if not lines:
        return None
    if lines[0] == CSV_HEAD:
        return "CSV"
    if re.match(r"date \w{3} ", lines[0]) and any(line.startswith("base ") for line in lines[:5]):
        return "ASC"
    if lines[0].startswith(";$FILEVERSION=") or (
        lines[0].startswith(";") and any(re.match(r";\s+Start time:", line) for line in lines)
    ):
        return "TRC"
    # A damaged line does not make it another format.
    for kind, pattern in (("candump", CANDUMP_LINE), ("candump on screen", SCREEN_LINE)):
        if sum(bool(pattern.match(line)) for line in lines) * 2 > len(lines):
            return kind
    return None
