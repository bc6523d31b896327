"""A CAN log of one object: our bulk decode against python-can messages through cantools; one frame at a time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks import peers
from benchmarks.can_streams import NODE, can_database, classic_log
from benchmarks.measurement import GAIN, Topic, figure, ratio, rounds_of
from firmware_protocol.can.decoder import CanStreamDecoder
from firmware_protocol.can.frames import CLASSIC_BYTES, RECORD_DTYPES, frame_array
from firmware_protocol.can.mapping import CanFunction, arbitration_id
from firmware_protocol.packets import OrientationBatch

BATCH_FRAMES = 4000


def batches(log: bytes, n_frames: int) -> list[bytes]:
    """Cut one frame batch into batches of so many frames, as reads of an interface give."""
    size = RECORD_DTYPES[CLASSIC_BYTES].itemsize
    records = log[8:]
    cut = [records[at : at + n_frames * size] for at in range(0, len(records), n_frames * size)]
    return [log[:4] + (len(part) // size).to_bytes(4, "little") + part for part in cut]


def decode(parts: list[bytes]) -> int:
    """Through the public decoder; samples."""
    decoder = CanStreamDecoder(NODE)
    items = [item for part in parts for item in decoder.feed(part)] + decoder.flush()
    return sum(len(item) for item in items if isinstance(item, OrientationBatch))


def measure(quick: bool = False) -> Topic:
    """Measure everything of this topic."""
    topic = Topic("CAN: frames of a log to samples")
    n = 100_000 if quick else 500_000
    n_few = 20_000
    log, short = classic_log(n), classic_log(n_few)
    bulk, single = batches(log, BATCH_FRAMES), batches(short, 1)
    assert decode(bulk) == n
    assert decode(single) == n_few
    n_bulk, n_single = (len(frame_array(data)) for data in (log, short))
    functions: dict[str, Callable[[], object]] = {
        "bulk": lambda: decode(bulk),
        "single": lambda: decode(single),
    }
    missing = peers.missing("cantools")
    if missing:
        topic.left_out.append(f"python-can + cantools: {missing}")
    else:
        functions["peer"] = _peer(short)
    times = rounds_of(functions, 3 if quick else 7)
    topic.rows.append(figure("bulk, ours", [n_bulk / t / 1e6 for t in times["bulk"]], "M frames/s"))
    topic.rows.append(
        figure("one frame a read, ours", [1e6 * t / n_single for t in times["single"]], "µs CPU/frame", "the live path")
    )
    if "peer" in times:
        peer = times["peer"]
        topic.rows.append(figure("python-can + cantools", [1e6 * t / n_single for t in peer], "µs CPU/frame"))
        scale = n_bulk / n_single
        topic.rows.append(ratio("bulk: ours / python-can + cantools", peer, times["bulk"], 3.0, GAIN, scale))
        topic.rows.append(ratio("one frame a read: ours / python-can + cantools", peer, times["single"]))
    return topic


def _peer(log: bytes) -> Callable[[], object]:
    """Messages of python-can, decoded by cantools, the quaternion completed: what a user would write."""
    import can

    database = can_database()
    records = frame_array(log)
    columns = (records["arbitration_id"].tolist(), records["code"].tolist())
    frames = [(identifier, code.to_bytes(8, "little")) for identifier, code in zip(*columns, strict=True)]
    wanted = arbitration_id(CanFunction.ORIENTATION, NODE)
    names = [[f"Quat{c}_{k}" for c in "WXYZ" if c != "WXYZ"[k]] for k in range(4)]

    def run() -> int:
        samples = []
        for identifier, data in frames:
            message = can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
            values = database.decode_message(message.arbitration_id, message.data)
            if identifier == wanted:
                index = int(values["LargestIndex"])
                q_wxyz = [values[name] for name in names[index]]
                q_wxyz.insert(index, float(np.sqrt(max(1.0 - sum(part * part for part in q_wxyz), 0.0))))
                samples.append((values["SampleCounter8"], q_wxyz))
        return len(samples)

    return run
