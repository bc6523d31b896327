"""Figures by what they show: the last digits of another processor are nothing, all that can be seen or read is."""

import io
import re
import struct
import zlib

import numpy as np
import pytest

from analysis.formats.parquet import parquet_bytes
from analysis.reporting import style as look
from analysis.series import OrientationSeries
from host.submission.drawn_comparison import shows_the_same


def figure(shift=0.0, label="θ̄ = 0.718°"):
    with look.style():
        drawn = look.new_figure(1.5)
        ax = drawn.subplots()
        x = np.linspace(0, 1, 50)
        ax.plot(x, np.sin(7 * x) * (1 + shift), color=look.BLUE)
        ax.scatter(x, np.cos(7 * x) * (1 + shift), s=2, rasterized=True)
        ax.set_title(label)
    return drawn


@pytest.fixture(scope="module")
def files():
    settings = {"same": {}, "near": {"shift": 3e-8}, "far": {"shift": 3e-2}, "label": {"label": "θ̄ = 0.717°"}}
    return {
        kind: {name: look.figure_bytes(figure(**values), kind) for name, values in settings.items()}
        for kind in look.FORMATS
    }


@pytest.mark.parametrize("kind", look.FORMATS)
def test_what_nobody_can_see_is_the_same_and_what_can_be_read_is_not(files, kind):
    drawn, name = files[kind], f"trials/a/figures/x.{kind}"
    assert shows_the_same(name, drawn["near"], drawn["same"])
    assert not shows_the_same(name, drawn["far"], drawn["same"])
    assert not shows_the_same(name, drawn["label"], drawn["same"])
    assert not shows_the_same(name, b"", drawn["same"])
    assert not shows_the_same(name, drawn["same"] + b"\n%", drawn["same"])
    assert not shows_the_same(name, drawn["same"][:-20], drawn["same"])


def test_a_svg_moved_by_a_millionth_of_a_point_is_the_same_and_by_a_thousandth_is_not(files):
    text = files["svg"]["same"].decode()
    number = re.search(r"L (\d+\.\d{4,})", text)[1]
    for change, same in ((1e-6, True), (1e-3, False)):
        moved = text.replace(number, f"{float(number) + change:.6f}")
        assert moved != text
        assert shows_the_same("x.svg", moved.encode(), text.encode()) is same


def chunk(kind, body):
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def test_a_png_packed_otherwise_is_the_same_and_with_words_in_it_is_not(files):
    from PIL import Image

    png = files["png"]["same"]
    again = io.BytesIO()
    picture = Image.open(io.BytesIO(png))
    picture.save(again, "PNG", compress_level=1, dpi=picture.info["dpi"])
    assert again.getvalue() != png
    assert shows_the_same("x.png", again.getvalue(), png)
    assert not shows_the_same("x.png", png[:33] + chunk(b"tEXt", b"Comment\0altered") + png[33:], png)
    pixels = np.array(picture)
    pixels[100, 100] = 255 - pixels[100, 100]
    changed = io.BytesIO()
    Image.fromarray(pixels).save(changed, "PNG", dpi=picture.info["dpi"])
    assert not shows_the_same("x.png", changed.getvalue(), png)


def test_a_picture_that_is_a_bomb_is_not_unpacked(files):
    png = files["png"]["same"]
    head = struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    bomb = png[:8] + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(bytes(2**24), 9)) + chunk(b"IEND", b"")
    assert not shows_the_same("x.png", bomb, png)
    inside = png[: png.index(b"IDAT") - 4] + chunk(b"IDAT", zlib.compress(bytes(2**26), 9)) + chunk(b"IEND", b"")
    assert not shows_the_same("x.png", inside, png)


def test_parquet_is_compared_value_by_value():
    pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    times_s = np.arange(50) / 100
    quats = np.tile([1.0, 0, 0, 0], (50, 1))
    ours = parquet_bytes(OrientationSeries(times_s, quats, np.arange(50)))
    near = parquet_bytes(OrientationSeries(times_s + 1e-13, quats, np.arange(50)))
    far = parquet_bytes(OrientationSeries(times_s + 1e-6, quats, np.arange(50)))
    assert near != ours
    assert shows_the_same("samples.parquet", near, ours)
    assert not shows_the_same("samples.parquet", far, ours)
    since_1970 = [parquet_bytes(OrientationSeries(times_s + 1.6e9 + off, quats, np.arange(50))) for off in (0.0, 1e-3)]
    assert not shows_the_same("samples.parquet", *since_1970)
    rows = [parquet_bytes(OrientationSeries(times_s, quats, np.arange(50) + 2**40 + off)) for off in (0, 1)]
    assert not shows_the_same("samples.parquet", *rows)
    for place in range(0, len(ours), 7):
        flipped = bytearray(ours)
        flipped[place] ^= 1
        if shows_the_same("samples.parquet", bytes(flipped), ours):
            # Then the bit was the last one of a number, and nothing else.
            values, others = (pq.read_table(io.BytesIO(data)).to_pydict() for data in (bytes(flipped), ours))
            assert values != others, place
