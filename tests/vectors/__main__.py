"""Write the golden vectors: ``python -m tests.vectors``.

The difference is to be read like any change of the protocol. A vector is never changed while the major version stays;
new ones are added.
"""

from tests.vectors.can_definitions import can_vectors_text
from tests.vectors.files import CAN_FILE, SERIAL_FILE
from tests.vectors.serial_definitions import vectors_text

if __name__ == "__main__":
    SERIAL_FILE.write_text(vectors_text(), encoding="utf-8")
    CAN_FILE.write_text(can_vectors_text(), encoding="utf-8")
