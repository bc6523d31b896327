"""The report as one HTML file that needs nothing else: no network, no other file, no fonts of its own."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import jinja2
from markupsafe import Markup

from analysis.reporting import wording
from analysis.reporting.figure_set import NamedFigure
from analysis.reporting.interactive import plotly_base64, scenes
from analysis.reporting.tables import COLUMNS, pool
from analysis.reporting.trial_report import TrialReport
from analysis.scoring.summary import degrees, doubt_text, interval_text, trust_rows

TEMPLATES = Path(__file__).parent / "templates"


def page_template(name: str) -> jinja2.Template:
    """Return a template: everything in it is escaped, a forgotten name is an error, the style sheet is at hand."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(name, globals={"css": _own("report.css")})


def report_html(
    trials: Sequence[TrialReport],
    *,
    title: str,
    version: str,
    drawn: Mapping[str, Sequence[NamedFigure]],
    forest: Mapping[str, bytes],
) -> str:
    """Return the report of one or several trials.

    Every text of cards, devices and files stands in the page as text, never as markup.

    Parameters
    ----------
    trials : sequence of TrialReport
        In the order of the report.
    title : str
        Title of the page.
    version : str
        Version of rotdrift, for the reader.
    drawn : mapping
        Figures by trial id, a ``svg`` and a ``png`` of each.
    forest : mapping
        The figure of the whole as ``svg``; not used where there is only one trial.
    """
    plotly = plotly_base64()
    pooled = pool([trial.figure for trial in trials])
    template = page_template("report.html")
    values: dict[str, object] = {
        "title": title,
        "version": version,
        "pages": [_trial_values(trial, drawn[trial.id]) for trial in trials],
        "about": wording.ABOUT,
        "pooled": pooled if any(row.n_trials > 1 for row in pooled) else [],
        "pooled_columns": COLUMNS,
        "cycle_columns": wording.CYCLE_COLUMNS,
        "forest": data_uri("image/svg+xml", forest["svg"]) if len(trials) > 1 else "",
        "incomplete": wording.missing_lines(trials),
        "js": _own("report.js"),
        "plotly": Markup(plotly),  # noqa: S704 - base64, from our own package
    }
    size = len(template.render(**values, sizes="").encode())
    sizes = (
        f"Size: {size / 1e6:.2f} MB, of which {len(plotly) / 1e6:.2f} MB are plotly.js (its 3-D bundle only, "
        "compressed; MIT licence)."
    )
    return template.render(**values, sizes=sizes)


def _own(name: str) -> Markup:
    return Markup((TEMPLATES / name).read_text(encoding="utf-8"))  # noqa: S704 - our own file


def _trial_values(trial: TrialReport, figures: Sequence[NamedFigure]) -> dict[str, object]:
    """Return what the page shows of a trial beside the trial itself."""
    found = scenes(trial)
    return {
        "trial": trial,
        "result": trial.result,
        "theta": degrees(trial.result.theta_bar_deg),
        "interval": interval_text(trial.result),
        "doubt": doubt_text(trial.result),
        "verdict": wording.verdict(trial),
        "trust": trust_rows(trial.result),
        "scenes": found,
        "scenes_json": _json_in_html(found),
        "still": data_uri("image/png", figures[0].files["png"]),
        "figures": [(figure.caption, data_uri("image/svg+xml", figure.files["svg"])) for figure in figures],
        "methods": wording.methods_text(trial),
        "cycles": wording.cycle_rows(trial),
    }


def data_uri(kind: str, content: bytes) -> str:
    """Return a file as an address that holds all of it."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"


def _json_in_html(values: object) -> Markup:
    """Return JSON that cannot end the script element it stands in."""
    text = json.dumps(values, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Markup(text)  # noqa: S704 - every character that could be markup is escaped
