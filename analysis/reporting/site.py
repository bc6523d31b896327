"""A comparison as pages: one file, or a static site with one page per hand and one per object. No script, no server."""

from __future__ import annotations

import base64
import re
import unicodedata
from collections.abc import Sequence

from markupsafe import Markup

from analysis.reporting import style as look
from analysis.reporting.comparison import CRITERION, Comparison, compare_figures, difference_text, forest_figure
from analysis.reporting.html import TEMPLATES, environment
from analysis.reporting.tables import COLUMNS, SummaryRow, summary_csv, summary_latex, summary_markdown

TITLE = "Rotation drift: results compared"


def comparison_html(
    comparison: Comparison,
    version: str,
    *,
    title: str = TITLE,
    pages: dict[str, str] | None = None,
    home: bool | None = None,
) -> str:
    """Return a comparison as one page that needs nothing else.

    Parameters
    ----------
    comparison : Comparison
        What to show.
    version : str
        Version of rotdrift.
    title : str, optional
        Title of the page.
    pages : dict, optional
        Page of each ``hand:NAME`` and ``object:NAME``; None for a page that stands alone.
    home : bool, optional
        True: link back to the index; False: this is the index; None: the page stands alone.
    """
    with look.style():
        figure = forest_figure(comparison.rows)
    picture = base64.b64encode(look.figure_bytes(figure, "svg")).decode("ascii")
    return (
        environment()
        .get_template("comparison.html")
        .render(
            title=title,
            css=Markup((TEMPLATES / "report.css").read_text(encoding="utf-8")),  # noqa: S704 - our own file
            notes=comparison.notes,
            columns=COLUMNS,
            rows=comparison.rows,
            pages=pages or {},
            forest=f"data:image/svg+xml;base64,{picture}",
            differences=[difference_text(difference) for difference in comparison.differences],
            criterion=CRITERION,
            version=version,
            home=home,
        )
    )


def site_files(comparison: Comparison, version: str) -> dict[str, bytes]:
    """Return the static site: index, a page per hand, a page per object, and the table as files.

    Parameters
    ----------
    comparison : Comparison
        What to show.
    version : str
        Version of rotdrift.

    Returns
    -------
    Content by file name; links are relative, so that it works from a folder as from a server.
    """
    pages = _page_names(comparison.rows)
    files = {
        "index.html": comparison_html(comparison, version, pages=pages, home=False).encode(),
        "summary.csv": summary_csv(comparison.rows).encode(),
        "summary.md": summary_markdown(comparison.rows).encode(),
        "summary.tex": summary_latex(comparison.rows).encode(),
    }
    for key, name in pages.items():
        kind, _, what = key.partition(":")
        part = compare_figures([row for row in comparison.rows if getattr(row, kind) == what], comparison)
        files[name] = comparison_html(part, version, title=f"Rotation drift: {what}", pages=pages, home=True).encode()
    return files


def _page_names(rows: Sequence[SummaryRow]) -> dict[str, str]:
    keys = list(dict.fromkeys([f"hand:{row.hand}" for row in rows] + [f"object:{row.object}" for row in rows]))
    names: dict[str, str] = {}
    for key in keys:
        flat = unicodedata.normalize("NFKD", key).encode("ascii", "ignore").decode().lower()
        stem = re.sub(r"[^a-z0-9]+", "-", flat).strip("-")[:60]
        name, number = f"{stem}.html", 2
        while name in names.values():
            name, number = f"{stem}-{number}.html", number + 1
        names[key] = name
    return names
