"""Serial decode: bulk against C, construct and peers; damaged streams; small reads and the crossover."""

from __future__ import annotations

import gc
from collections.abc import Callable
from itertools import pairwise
from statistics import median

import numpy as np

from benchmarks import peers
from benchmarks.measurement import COST, GAIN, Curve, Topic, figure, ratio, rounds_of
from benchmarks.native import NoCompilerError, native_decode
from benchmarks.sample_streams import FRAME_BYTES, Stream, clean_stream, mixed_stream
from firmware_protocol.packets import OrientationBatch
from firmware_protocol.serial import decoder as stream_module
from firmware_protocol.serial.decoder import StreamDecoder

CHUNK_BYTES = 1 << 20
_PEERS: dict[str, tuple[Callable[[int], Callable[[], object]], str, float]] = {
    "construct, compiled": (peers.construct_parse, "construct", 50.0),
    "pymavlink": (peers.pymavlink_parse, "pymavlink", 100.0),
    "ximu3": (peers.ximu3_parse, "ximu3", 100.0),
    "cantools": (peers.cantools_parse, "cantools", 20.0),
}


def decode_ours(data: bytes, chunk: int = CHUNK_BYTES) -> int:
    """Decode through the public decoder; return the samples."""
    decoder = StreamDecoder()
    n = 0
    for start in range(0, len(data), chunk):
        for item in decoder.feed(data[start : start + chunk]):
            if isinstance(item, OrientationBatch):
                n += len(item)
    return n


def _checked(stream: Stream) -> bytes:
    n = decode_ours(stream.data)
    assert abs(n - stream.n_samples) <= 1 + stream.n_samples * 1e-5, (n, stream.n_samples)
    return stream.data


def measure(quick: bool = False) -> Topic:
    """Measure everything of this topic."""
    topic = Topic("Decode: serial stream to samples")
    n = 1 << 20
    rounds = 3 if quick else 7
    clean = _checked(clean_stream(n))
    mixed = _checked(mixed_stream(n))
    functions: dict[str, Callable[[], object]] = {
        "ours, clean": lambda: decode_ours(clean),
        "ours, mixed": lambda: decode_ours(mixed),
        "memcpy": lambda: np.frombuffer(clean, np.uint8).copy(),
    }
    try:
        native_decode(clean[:21])
        functions["C, clean"] = lambda: native_decode(clean)
        functions["C, mixed"] = lambda: native_decode(mixed)
    except NoCompilerError as error:
        topic.left_out.append(f"C decoder: {error}")
    n_peer = 10_000 if quick else 50_000
    for name, (make, module, _) in _PEERS.items():
        why = peers.missing(module)
        if why:
            topic.left_out.append(f"{name}: {why}")
        else:
            functions[name] = make(n_peer)
    gc.collect()
    gc.freeze()  # the modules and samples of one are no garbage for another to look through
    times = rounds_of(functions, rounds)
    gc.unfreeze()

    ours = times["ours, clean"]
    topic.rows.append(figure("clean, ours", [n / t / 1e6 for t in ours], "M samples/s"))
    topic.rows.append(
        figure("1 % damaged, 2 % others, ours", [n / t / 1e6 for t in times["ours, mixed"]], "M samples/s")
    )
    if "C, clean" in times:
        topic.rows.append(figure("clean, C", [n / t / 1e6 for t in times["C, clean"]], "M samples/s"))
        topic.rows.append(ratio("clean: rate of ours / rate of C", times["C, clean"], ours, 0.35))
        topic.rows.append(ratio("1 % damaged, 2 % others: ours / C", times["C, mixed"], times["ours, mixed"], 0.15))
    topic.rows.append(ratio("mixed: ours / ours on clean", ours, times["ours, mixed"]))
    topic.rows.append(ratio("time of ours / memcpy of the same bytes", ours, times["memcpy"], sense=COST))
    for name, (_, _, goal) in _PEERS.items():
        if name in times:
            topic.rows.append(
                ratio(f"clean: ours / {name}", times[name], ours, goal, GAIN, n / n_peer, "per sample, its own format")
            )
    _small_reads(topic, clean, quick)
    return topic


def _small_reads(topic: Topic, clean: bytes, quick: bool) -> None:
    """Cost per frame by frames per read: each of the two paths alone, and as it is."""
    sizes = (1, 10, 100, 150, 400) if quick else (1, 2, 4, 8, 16, 32, 64, 100, 115, 130, 150, 200, 300, 400, 1000, 4000)
    rounds = 3 if quick else 7
    curves: dict[str, list[float]] = {"as used": [], "one by one": [], "together": []}
    ranges: dict[int, tuple[float, float]] = {}
    threshold = stream_module.BATCH_BYTES
    for size in sizes:
        # Short pieces of work, many rounds: the median then sits between the disturbances of a shared machine.
        n = max(size, 2000 if size < 100 else 20_000) // size * size
        data = clean[: n * FRAME_BYTES]
        edges = range(0, len(data) + 1, size * FRAME_BYTES)
        reads = [data[a:b] for a, b in pairwise(edges)]

        def run(limit: int, reads: list[bytes] = reads) -> None:
            stream_module.BATCH_BYTES = limit
            feed = StreamDecoder().feed
            for read in reads:
                feed(read)

        functions = {"as used": lambda: run(threshold)}
        if not (quick and size < 100):
            functions["one by one"] = lambda: run(1 << 40)
            functions["together"] = lambda: run(1)
        try:
            times = rounds_of(functions, rounds if size > 64 else 3 * rounds)
        finally:
            stream_module.BATCH_BYTES = threshold
        for name, values in times.items():
            per_frame = [1e6 * value / n for value in values]
            curves[name].append(median(per_frame))
            if name == "as used":
                ranges[size] = (min(per_frame), max(per_frame))
    used = curves["as used"]
    for size in (1, 10 if quick else 8, 100, 400):
        values = [*ranges[size], used[sizes.index(size)]]
        name = f"{size} frame{'s' * (size > 1)} a read"
        topic.rows.append(figure(name, values, "µs/frame", goal=3.0, sense=COST))
    cut = clean[10 : 10 + 2000 * FRAME_BYTES]  # what is there when it is read need not end where a frame does
    pieces = [cut[start : start + FRAME_BYTES] for start in range(0, len(cut), FRAME_BYTES)]

    def run_cut() -> None:
        feed = StreamDecoder().feed
        for piece in pieces:
            feed(piece)

    times = rounds_of({"cut": run_cut}, 3 * rounds)
    values = [1e6 * value / len(pieces) for value in times["cut"]]
    topic.rows.append(figure("1 frame a read, each cut in the middle", values, "µs/frame", goal=3.0, sense=COST))
    worst = max(range(len(sizes)), key=lambda k: used[k])
    name = f"worst of all sizes ({sizes[worst]} a read)"
    topic.rows.append(figure(name, [used[worst]], "µs/frame", goal=3.0, sense=COST))
    if not quick:
        for name, values in curves.items():
            label = "frames per read", "µs per frame"
            topic.curves.append(Curve(name, *label, tuple(map(float, sizes)), tuple(values)))
        pairs = list(zip(sizes, curves["one by one"], curves["together"], strict=True))
        last_worse = max(size for size, a, b in pairs if b >= a and size > 1)  # a lone frame has a path of its own
        better = [size for size in sizes if size > last_worse]
        topic.rows.append(figure("crossover measured: together is faster from", [float(min(better))], "frames"))
        topic.rows.append(figure("crossover used (BATCH_BYTES)", [threshold / FRAME_BYTES], "frames"))
