"""The report as one HTML file that needs nothing else: no network, no other file, no fonts of its own."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from analysis.reporting import overview, wording
from analysis.reporting.figure_set import NamedFigure, draw_figures
from analysis.reporting.interactive import plotly_base64, scenes
from analysis.reporting.trial_report import TrialReport

TEMPLATES = Path(__file__).parent / "templates"


def environment() -> jinja2.Environment:
    """Make the template environment: everything escaped, a forgotten name is an error."""
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
    )


def report_html(
    trials: Sequence[TrialReport],
    *,
    title: str,
    version: str,
    drawn: dict[str, tuple[NamedFigure, ...]] | None = None,
    forest: dict[str, bytes] | None = None,
) -> str:
    """Write the report of one or several trials.

    Parameters
    ----------
    trials
        In the order of the report.
    title
        Title of the page.
    version
        Version of rotdrift, for the reader.
    drawn
        Figures by trial id with a ``svg`` and a ``png`` of each, where they were drawn already.
    forest
        The figure of the whole as ``svg``, where it was drawn already.

    Returns
    -------
    The page. Every text of cards, devices and files stands in it as text, never as markup.
    """
    plotly = plotly_base64()
    pooled = overview.pooled(trials)
    pages = [
        _trial_values(trial, (drawn or {}).get(trial.id) or draw_figures(trial, ("png", "svg"))) for trial in trials
    ]
    template = environment().get_template("report.html")
    values: dict[str, Any] = {
        "title": title,
        "version": version,
        "trials": pages,
        "about": wording.ABOUT,
        "pooled": pooled if any(row.n_trials > 1 for row in pooled) else [],
        "pooled_columns": overview.COLUMNS,
        "cells": overview.cells,
        "forest": _data_uri("image/svg+xml", (forest or {}).get("svg") or overview.forest(pooled, "svg"))
        if len(trials) > 1
        else "",
        "incomplete": wording.missing_lines(trials),
        "css": _own("report.css"),
        "js": _own("report.js"),
        "plotly": Markup(plotly),  # noqa: S704 - base64, from our own package
    }
    size = len(template.render(**values, sizes="").encode())
    sizes = (
        f"Size: {size / 1e6:.2f} MB, of which {len(plotly) / 1e6:.2f} MB are plotly.js (its 3-D bundle only, "
        f"compressed; MIT "
        "licence)."
    )
    return template.render(**values, sizes=sizes)


def _own(name: str) -> Markup:
    return Markup((TEMPLATES / name).read_text(encoding="utf-8"))  # noqa: S704 - our own file


def _trial_values(trial: TrialReport, figures: Sequence[NamedFigure]) -> dict[str, Any]:
    found = scenes(trial)
    view = trial.view
    return {
        "id": trial.id,
        "title": trial.title,
        "hand": trial.hand,
        "object": trial.object,
        "motion": trial.motion,
        "valid": view.valid,
        "theta": wording.degrees(view.theta_bar_deg),
        "interval": wording.interval_text(trial),
        "n_endpoints": view.n_endpoints,
        "period": "" if view.period_s is None else f"{view.period_s:.2f}",
        "verdict": wording.verdict(trial),
        "reasons": trial.result.get("reasons") or ["the result gives no reason"],
        "warnings": trial.result.get("warnings") or [],
        "trust": wording.trust_rows(trial),
        "scenes": found,
        "scenes_json": _json_in_html(found),
        "still": _data_uri("image/png", figures[0].files["png"]),
        "figures": [
            {"caption": figure.caption, "src": _data_uri("image/svg+xml", figure.files["svg"])} for figure in figures
        ],
        "comments": trial.comments,
        "cards": trial.cards,
        "methods": wording.methods_text(trial),
        "cycles": wording.cycle_rows(trial),
        "cycle_columns": wording.CYCLE_COLUMNS,
        "provenance": trial.provenance,
        "notes": trial.notes,
    }


def _data_uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"


def _json_in_html(values: object) -> Markup:
    """JSON that cannot end the script element it stands in."""
    text = json.dumps(values, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Markup(text)  # noqa: S704 - every character that could be markup is escaped
