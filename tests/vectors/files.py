"""The golden vectors as they are shipped: bytes and what they mean, good and bad."""

import json
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[2] / "firmware_protocol" / "vectors"
SERIAL_FILE = FOLDER / "serial.json"
CAN_FILE = FOLDER / "can.json"


def load_vectors() -> dict[str, Any]:
    """Return the vectors of the serial protocol; ``docs/protocol.md`` describes the sections."""
    loaded: dict[str, Any] = json.loads(SERIAL_FILE.read_text(encoding="utf-8"))
    return loaded
