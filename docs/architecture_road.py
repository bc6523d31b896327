"""Write what docs/architecture.md draws and lists from the code itself: ``python docs/architecture_road.py``.

The floors are the ``layers`` contracts of pyproject.toml; the sentence beside a room is the first of its docstring. A
test runs the same functions and compares, so that neither drawing nor page can say what the code does not.
"""

from __future__ import annotations

import ast
import re
import tomllib
from dataclasses import dataclass
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "architecture.md"
PICTURE = ROOT / "docs" / "pictures" / "architecture.svg"
PACKAGES = ("emulator", "firmware_protocol", "host", "analysis")
"""Columns of the drawing, from left to right."""


@dataclass(frozen=True)
class Stage:
    """One stop of a sample: which module hands it on, and in what shape."""

    module: str
    """Module whose code does the work."""
    shape: str
    """``module.Class`` of what leaves it."""


ROAD = (
    Stage("host.links.reader_thread", "host.links.transport.Chunk"),
    Stage("host.recording.writer", "host.recording.format.Topic"),
    Stage("firmware_protocol.serial.decoder", "firmware_protocol.packets.OrientationBatch"),
    Stage("host.stream.samples", "host.stream.blocks.SampleBlock"),
    Stage("analysis.cycles.online.detector", "analysis.cycles.settings.Endpoint"),
    Stage("host.trial.running_score", "host.trial.state.CycleRow"),
    Stage("host.screen.dashboard.picture", "host.trial.state.TrialState"),
    Stage("host.recording.load", "analysis.series.OrientationSeries"),
    Stage("analysis.cycles.search", "analysis.cycles.settings.CycleAnalysis"),
    Stage("analysis.scoring.trial", "analysis.scoring.result.Result"),
    Stage("analysis.reporting.html", "analysis.reporting.trial_report.TrialReport"),
    Stage("host.submission.contents", "host.submission.manifest.Submission"),
)
"""From the port to the report. 1 to 7 happen while the hand turns, the others from the recording."""
LIVE = 7


def floors(package: str) -> list[list[str]]:
    """Return the rooms of a package, top floor first; rooms of one floor in one list."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    (found,) = [
        contract for contract in contracts if contract["type"] == "layers" and contract["containers"] == [package]
    ]
    return [re.split(r"\s*[|:]\s*", layer) for layer in found["layers"]]


def first_sentence(name: str) -> str:
    """Return the first sentence of the docstring of a room, a module or ``module.Class``.

    Raises
    ------
    LookupError
        There is no such thing, or nothing is written about it.
    """
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        place = ROOT.joinpath(*parts[:length])
        path = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
        if path.is_file():
            break
    else:
        raise LookupError(f"there is no {name}")
    node: ast.AST = ast.parse(path.read_text(encoding="utf-8"))
    for part in parts[length:]:
        found = [item for item in ast.iter_child_nodes(node) if getattr(item, "name", None) == part]
        if not found:
            raise LookupError(f"there is no {part} in {path.relative_to(ROOT)}")
        node = found[0]
    text = ast.get_docstring(node) if isinstance(node, ast.Module | ast.ClassDef) else None
    if not text:
        raise LookupError(f"{name} has no docstring")
    return re.sub(r":\w+:`~?([^`]*)`", r"`\1`", " ".join(text.split("\n\n")[0].split()))


def room_of(module: str) -> tuple[str, str]:
    """Return package and room of a module."""
    package, room = module.split(".")[:2]
    return package, room


def road_table() -> str:
    """Return the road as a Markdown table: a row for each stop."""
    rows = ["| | module | what it does | what leaves it |", "|---|---|---|---|"]
    for number, stage in enumerate(ROAD, 1):
        module, _, shape = stage.shape.rpartition(".")
        first_sentence(stage.shape)
        rows.append(f"| {number} | `{stage.module}` | {first_sentence(stage.module)} | `{shape}` (`{module}`) |")
    return "\n".join(rows)


def rooms_table() -> str:
    """Return the rooms of every package as a Markdown table, top floor first."""
    rows = ["| room | what is in it |", "|---|---|"]
    for package in reversed(PACKAGES):
        rows.append(f"| **{package}** | **{first_sentence(package)}** |")
        rows += [
            f"| `{package}.{room}` | {first_sentence(f'{package}.{room}')} |"
            for floor in floors(package)
            for room in floor
        ]
    return "\n".join(rows)


WIDTHS = {"emulator": 210, "firmware_protocol": 290, "host": 330, "analysis": 220}
GAP, TOP, FLOOR, ROOM = 46, 74, 50, 34
STYLE = """
text { font: 14px system-ui, sans-serif; fill: #1f2933 }
.title { font-weight: 600; font-size: 16px } .quiet { fill: #616e7c; font-size: 13px }
.room { fill: #eef2f6; stroke: #9aa5b1 } .house { fill: none; stroke: #cbd2d9 }
.live { fill: none; stroke: #0b7285; stroke-width: 2.5 }
.later { fill: none; stroke: #b3541e; stroke-width: 2.5; stroke-dasharray: 7 5 }
.stop { stroke: #fff; stroke-width: 1.5 } .number { fill: #fff; font-size: 11px; font-weight: 700; text-anchor: middle }
.plate { fill: #fff } .wire { fill: none; stroke: #9aa5b1; stroke-width: 2 }
.name { paint-order: stroke; stroke: #eef2f6; stroke-width: 4px }
"""


def drawing() -> str:
    """Return the SVG: packages side by side, floors as their contracts have them, and the road through the rooms."""
    houses = {package: floors(package) for package in PACKAGES}
    height = TOP + max(map(len, houses.values())) * FLOOR + 84
    left, boxes, names, places = 16, [], [], {}
    for package in PACKAGES:
        width, stack = WIDTHS[package], houses[package]
        top = height - 66 - len(stack) * FLOOR
        boxes.append(
            f'<rect class="house" x="{left}" y="{top - 34}" width="{width}" height="{len(stack) * FLOOR + 40}" rx="6"/>'
        )
        boxes.append(f'<text class="title" x="{left + 12}" y="{top - 12}">{package}</text>')
        for level, rooms in enumerate(stack):
            each = (width - 20 - 6 * (len(rooms) - 1)) / len(rooms)
            for place, room in enumerate(rooms):
                x, y = left + 10 + place * (each + 6), top + level * FLOOR + 4
                places[package, room] = (x, y, each)
                size = ' style="font-size: 11px"' if len(room) * 8 > each else ""
                boxes.append(f'<rect class="room" x="{x:.0f}" y="{y}" width="{each:.0f}" height="{ROOM}" rx="4"/>')
                names.append(f'<text class="name" x="{x + 8:.0f}" y="{y + 22}"{size}>{escape(room)}</text>')
        left += width + GAP
    stops = _stops(places)
    wire = [places["emulator", "links"], places["host", "links"]]
    bytes_from = [(wire[0][0] + wire[0][2], wire[0][1] + ROOM / 2), stops[0]]
    lines = [_line("wire", bytes_from), _line("live", stops[:LIVE]), _line("later", [stops[1], *stops[LIVE:]])]
    road = []
    for number, (x, y) in enumerate(stops, 1):
        colour = "#0b7285" if number <= LIVE else "#b3541e"
        road.append(f'<circle class="stop" cx="{x:.0f}" cy="{y:.0f}" r="9" fill="{colour}"/>')
        road.append(f'<text class="number" x="{x:.0f}" y="{y + 4:.0f}">{number}</text>')
    width = left - GAP + 16
    legend = (
        f'<text class="quiet" x="16" y="{height - 32}">A room may use the rooms below it, never those above. '
        "Blue, 1 to 7: a sample while the hand turns.</text>"
        f'<text class="quiet" x="16" y="{height - 12}">'
        "Brown, dashed: the same samples from the recording to the report. "
        "Grey: bytes of the virtual object, on a real port.</text>"
    )
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        'role="img">'
        "<title>The rooms of rotdrift and the road of one sample</title>"
        f'<style>{STYLE}</style><rect class="plate" width="{width}" height="{height}"/>'
        '<text class="title" x="16" y="28">The road of one sample, from the port to the report</text>'
    )
    return "\n".join([head, *boxes, *lines, *names, *road, legend, "</svg>"]) + "\n"


def _stops(places: dict[tuple[str, str], tuple[float, float, float]]) -> list[tuple[float, float]]:
    """Where each stop stands: at the right end of its room, several in one room side by side."""
    seen: dict[tuple[str, str], int] = {}
    stops = []
    for stage in ROAD:
        room = room_of(stage.module)
        x, y, width = places[room]
        before = seen.get(room, 0)
        seen[room] = before + 1
        stops.append((x + width - 12 - 22 * before, y + ROOM / 2))
    return stops


def _line(kind: str, stops: list[tuple[float, float]]) -> str:
    """One way through stops, bent so that it leaves and reaches each of them level."""
    (x, y), *others = stops
    path = f"M {x:.0f} {y:.0f}"
    for to_x, to_y in others:
        bend = 40 if abs(to_x - x) < 60 else 0
        path += f" C {x + bend:.0f} {(y + to_y) / 2:.0f}, {to_x + bend:.0f} {(y + to_y) / 2:.0f}, {to_x:.0f} {to_y:.0f}"
        x, y = to_x, to_y
    return f'<path class="{kind}" d="{path}"/>'


def filled(text: str) -> str:
    """Return the page with its generated parts made again."""
    for name, part in (("road", road_table()), ("rooms", rooms_table())):
        text = re.sub(
            rf"(<!-- {name}: made by docs/architecture_road.py -->\n).*?(\n<!-- end -->)",
            lambda match, part=part: match.group(1) + part + match.group(2),
            text,
            flags=re.DOTALL,
        )
    return text


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    PICTURE.write_text(drawing(), encoding="utf-8")
