"""The style of figures, and how they become bytes: one paper column wide, colour-blind safe, the same bytes every time.

No pyplot: figures are objects, nothing is global, and no window system is asked for.
"""

from __future__ import annotations

import functools
import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font
from matplotlib.ft2font import __freetype_version__

COLUMN_IN = 3.5
"""Width of one column of a two-column paper, inches (89 mm)."""

BLUE, ORANGE, GREEN, VERMILION = "#0072B2", "#E69F00", "#009E73", "#D55E00"
SKY, GREY, LIGHT, INK = "#56B4E9", "#777777", "#CCCCCC", "#222222"
"""Okabe and Ito's palette: distinguished by every kind of colour vision; lightness differs as well, for grey print."""

AXIS_COLOURS = (VERMILION, GREEN, BLUE)
AXIS_MARKERS = ("o", "^", "s")
"""The object's x, y, z: by colour and by shape."""

FORMATS = ("png", "svg", "pdf")
PNG_DPI = 300
"""What journals ask for."""
FREETYPE_VERSION: str = __freetype_version__
"""What draws the letters of a PNG: not every build of one matplotlib has the same."""

_SETTINGS: Any = {
    "font.family": "DejaVu Sans",  # ships with matplotlib and has θ̄
    "font.size": 7.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 7.0,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "text.color": INK,
    "text.parse_math": False,  # a `$` in a name is a dollar sign
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.fontsize": 6.5,
    "legend.frameon": False,
    "lines.linewidth": 0.9,
    "grid.color": LIGHT,
    "grid.linewidth": 0.4,
    "figure.dpi": PNG_DPI,
    "savefig.dpi": PNG_DPI,
    "svg.hashsalt": "rotdrift",
    "svg.fonttype": "path",
    "pdf.fonttype": 42,
}


@contextmanager
def style() -> Iterator[None]:
    """Make figures in here, or decorate what makes them: no setting of the user counts, and all are restored."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_SETTINGS)
        yield


class PaperFigure(Figure):
    """A figure that a notebook shows as it would be printed."""

    def _repr_png_(self) -> bytes:
        return figure_bytes(self, "png", dpi=150)


def new_figure(height_in: float, width_in: float = COLUMN_IN, layout: str = "constrained") -> PaperFigure:
    """Return an empty figure with its own canvas; ``layout`` is matplotlib's engine, ``constrained`` or ``none``."""
    figure = PaperFigure(figsize=(width_in, height_in), layout=layout)  # type: ignore[arg-type]
    FigureCanvasAgg(figure)
    return figure


@functools.cache
def _glyphs() -> frozenset[int]:
    return frozenset(get_font(findfont("DejaVu Sans")).get_charmap())


def drawable(text: str) -> str:
    """Return a text with a visible mark (U+FFFD) for every control character and every one the font cannot draw."""
    return "".join(c if (ord(c) in _glyphs() and c.isprintable()) or c == "\n" else "\ufffd" for c in text)


def settle(figure: Figure) -> None:
    """Fix the place of everything: the constrained layout settles over several draws, and formats must not differ."""
    if figure.get_layout_engine() is not None:
        for _ in range(3):
            figure.draw_without_rendering()
        figure.set_layout_engine("none")


@style()
def figure_bytes(figure: Figure, kind: str, dpi: int = PNG_DPI) -> bytes:
    """Return a figure as a file of one of ``FORMATS``; the same figure gives the same bytes.

    ``dpi`` is also the resolution of the clouds in SVG and PDF, pixels per inch.
    """
    metadata: dict[str, dict[str, str | None]] = {
        "png": {"Software": None},
        "svg": {"Date": None, "Creator": "rotdrift"},
        "pdf": {"CreationDate": None, "Creator": "rotdrift", "Producer": None},
    }
    buffer = io.BytesIO()
    settle(figure)
    figure.savefig(buffer, format=kind, dpi=dpi, metadata=metadata[kind], facecolor="white")
    return buffer.getvalue()
