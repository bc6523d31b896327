"""A comparison as pages: one file, or a static site with one page per hand and one per object. No script, no server."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence

from analysis.reporting.comparison import CRITERION, Comparison, compare_figures, difference_text, forest_bytes
from analysis.reporting.html import data_uri, page_template
from analysis.reporting.tables import COLUMNS, VERIFIED, ComparedRow, summary_csv, summary_latex, summary_markdown


def comparison_html(
    comparison: Comparison,
    version: str,
    *,
    title: str = "Rotation drift: results compared",
    pages: dict[str, str] | None = None,
    home: bool | None = None,
) -> str:
    """Return a comparison as one page that needs nothing else.

    ``pages`` is the page of each ``hand:NAME`` and ``object:NAME`` of a site. ``home`` is True for a page that links
    back to the index, False for the index itself, and None for a page that stands alone.
    """
    return page_template("comparison.html").render(
        title=title,
        notes=comparison.notes,
        columns=(*COLUMNS, VERIFIED),
        rows=comparison.rows,
        pages=pages or {},
        forest=data_uri("image/svg+xml", forest_bytes(comparison.rows, "svg")),
        differences=[difference_text(difference) for difference in comparison.differences],
        criterion=CRITERION,
        version=version,
        home=home,
    )


def site_files(comparison: Comparison, version: str) -> dict[str, bytes]:
    """Return the static site: index, a page per hand, a page per object, and the table as files, by name.

    Links are relative, so that it works from a folder as from a server.
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


def _page_names(rows: Sequence[ComparedRow]) -> dict[str, str]:
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
