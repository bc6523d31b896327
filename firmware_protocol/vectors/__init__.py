"""Golden vectors of the serial protocol: bytes and what they mean, good and bad, in ``serial.json``.

They are for whoever writes another end of the wire: firmware first of all. Every vector is also a test of this package.
``python -m firmware_protocol.vectors`` writes the file again; the difference is to be read like any change of the
protocol. A vector is never changed while the major version stays; new ones are added.
"""

from __future__ import annotations

import json
from importlib import resources
from typing import Any

FILE_NAME = "serial.json"
CAN_FILE_NAME = "can.json"
"""The same for the frames on CAN."""


def load_vectors() -> dict[str, Any]:
    """Return the shipped vectors; ``docs/protocol.md`` describes the sections."""
    loaded: dict[str, Any] = json.loads(resources.files(__name__).joinpath(FILE_NAME).read_text(encoding="utf-8"))
    return loaded
