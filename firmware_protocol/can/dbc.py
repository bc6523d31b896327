"""The DBC file of one object, for bus analysers: the shipped file, renumbered for its node id.

``firmware_protocol/sensorized_object.dbc`` describes node 1. For another node::

    python -m firmware_protocol.can.dbc 5 > object5.dbc
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from importlib import resources

from firmware_protocol.can.mapping import CanFunction, arbitration_id

SHIPPED_NODE = 1
_FRAME_ID = re.compile(r'^((?:BO_|CM_ BO_|CM_ SG_|BA_ "VFrameFormat" BO_|VAL_) )(\d+)', re.MULTILINE)
"""The lines of the file that name a frame by its arbitration id."""


def dbc_text(node: int = SHIPPED_NODE) -> str:
    """Return the DBC file of the object with this node id.

    Raises
    ------
    PacketValueError
        No such node id.
    """
    # A node id is the low bits of every id: one step moves them all.
    step = arbitration_id(CanFunction.COMMAND, node) - arbitration_id(CanFunction.COMMAND, SHIPPED_NODE)
    shipped = resources.files("firmware_protocol").joinpath("sensorized_object.dbc").read_text(encoding="utf-8")
    renumbered = _FRAME_ID.sub(lambda line: f"{line[1]}{int(line[2]) + step}", shipped)
    return renumbered.replace(f"Benchmark, node {SHIPPED_NODE}.", f"Benchmark, node {node}.")


def main(arguments: Sequence[str]) -> int:
    """Write the DBC of a node (1 by default) to standard output."""
    sys.stdout.write(dbc_text(int(arguments[0]) if arguments else SHIPPED_NODE))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
