"""Write the golden vectors: ``python -m firmware_protocol.vectors``."""

from pathlib import Path

from firmware_protocol.vectors import CAN_FILE_NAME, FILE_NAME
from firmware_protocol.vectors.can_definitions import can_vectors_text
from firmware_protocol.vectors.definitions import vectors_text

if __name__ == "__main__":
    Path(__file__).with_name(FILE_NAME).write_text(vectors_text(), encoding="utf-8")
    Path(__file__).with_name(CAN_FILE_NAME).write_text(can_vectors_text(), encoding="utf-8")
