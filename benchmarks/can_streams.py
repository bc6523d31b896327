"""CAN traffic of one object, made fast: samples as arrays, TIME and SAMPLE_STATE where the mapping wants them."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.sample_streams import turning
from firmware_protocol.can.dbc import dbc_text
from firmware_protocol.can.frames import BATCH_VERSION, CLASSIC_BYTES, RECORD_DTYPES
from firmware_protocol.can.mapping import CanFunction, arbitration_id, sample_state_data, time_data, time_interval
from firmware_protocol.quantization import quats_to_smallest_three

NODE = 1
RATE_HZ = 1000


def can_database() -> Any:
    """Our DBC, read by cantools."""
    import cantools

    return cantools.database.load_string(dbc_text(NODE), "dbc")


def _codes(n: int) -> npt.NDArray[np.uint64]:
    return (quats_to_smallest_three(turning(n)) << np.uint64(8)) | (np.arange(n, dtype=np.uint64) & np.uint64(0xFF))


def classic_samples(n: int) -> list[tuple[int, bytes]]:
    """Arbitration id and data of n ORIENTATION frames."""
    identifier = arbitration_id(CanFunction.ORIENTATION, NODE)
    return [(identifier, code.to_bytes(8, "little")) for code in _codes(n).tolist()]


def classic_log(n: int) -> bytes:
    """One frame batch with n samples, and the TIME and SAMPLE_STATE frames they need."""
    interval = time_interval(RATE_HZ)
    marks = range(0, n, interval)
    dtype = RECORD_DTYPES[CLASSIC_BYTES]
    records = np.zeros(n + 2 * len(marks), dtype)
    place = np.arange(n) + 2 * (np.arange(n) // interval + 1)
    host_ns = 1_000_000_000 + np.arange(n) * 1_000_000
    records["interface_time_s"] = np.nan
    records["length"] = 8
    records["arbitration_id"][place] = arbitration_id(CanFunction.ORIENTATION, NODE)
    records["code"][place] = _codes(n)
    records["host_time_ns"][place] = host_ns
    for k, counter in enumerate(marks):
        row = counter + 2 * k
        state = sample_state_data(counter, 8, RATE_HZ, 1)
        mark = time_data(counter, counter * 1000)
        for step, (function, data) in enumerate(((CanFunction.SAMPLE_STATE, state), (CanFunction.TIME, mark))):
            records["arbitration_id"][row + step] = arbitration_id(function, NODE)
            records["code"][row + step] = int.from_bytes(data, "little")
            records["host_time_ns"][row + step] = host_ns[counter]
    return struct.pack("<2sBBI", b"CF", BATCH_VERSION, CLASSIC_BYTES, len(records)) + records.tobytes()
