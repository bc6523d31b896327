"""``rotdrift compare``: results of several hands, objects, motions and laboratories side by side."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from analysis.reporting.comparison import Comparison


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    parser = subparsers.add_parser(
        "compare",
        help="put submissions side by side: table, forest plot, static site",
        description=(
            "Compare submissions (.zip), results of `rotdrift score --json` (.json), or folders of them. Submissions "
            "are scored again from the recordings in them; what cannot be is marked as not verified. Without "
            "--out the table is printed as Markdown. --out NAME.csv, .md, .tex, .html, .svg, .png or .pdf (forest "
            "plot), or a folder: a static site with one page per hand and one per object."
        ),
    )
    parser.add_argument("sources", nargs="+", type=Path, metavar="BUNDLE|RESULT", help="what to compare")
    parser.add_argument("--out", type=Path, metavar="FILE|FOLDER", help="what to write")
    parser.add_argument("--mix", action="store_true", help="compare even results made by different rules, with a note")
    parser.add_argument(
        "--no-verify",
        action="store_true",
        help="do not score the recordings again (faster); every row is marked as not verified",
    )
    parser.add_argument("--force", action="store_true", help="replace files that exist")


def run(args: argparse.Namespace) -> int:
    """Compare results, and print or write the comparison.

    Raises
    ------
    UsageError
        Results made by different rules, without --mix.
    FileError
        A file cannot be read or written.
    """
    from analysis.reporting.comparison import CRITERION, ComparisonError, compare, difference_text
    from analysis.reporting.tables import summary_markdown
    from host.errors import UsageError, already_there, unwritable
    from host.output.lines import write_line, write_lines, write_note
    from host.submission.comparison_sources import load_sources

    try:
        comparison = compare(load_sources(args.sources, verify=not args.no_verify), mix=args.mix)
    except ComparisonError as error:
        raise UsageError(
            f"these results do not follow the same rules ({error})", "compare them nevertheless with --mix"
        ) from error
    if args.out is None:
        lines = [*summary_markdown(comparison.rows).rstrip("\n").split("\n"), ""]
        lines += [difference_text(difference) for difference in comparison.differences]
        lines += [CRITERION] if comparison.differences else []
        write_lines([*lines, *comparison.notes])
        return 0
    files = _files(args.out, comparison)
    try:
        for path in files:
            if path.exists() and not args.force:
                raise already_there(path, "give another name, or replace it with --force")
        for path, content in files.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
    except OSError as error:
        raise unwritable(args.out, error) from error
    for note in comparison.notes:
        write_note(note)
    what = f"{len(files)} files, start with index.html" if len(files) > 1 else f"{len(comparison.rows)} rows"
    write_line(f"wrote {args.out}: {what}")
    return 0


def _files(out: Path, comparison: Comparison) -> dict[Path, bytes]:
    from analysis.reporting.comparison import forest_bytes
    from analysis.reporting.site import comparison_html, site_files
    from analysis.reporting.tables import summary_csv, summary_latex, summary_markdown
    from host.version import VERSION

    kind = out.suffix.lower()
    texts = {".csv": summary_csv, ".md": summary_markdown, ".tex": summary_latex}
    if kind in texts:
        return {out: texts[kind](comparison.rows).encode()}
    if kind == ".html":
        return {out: comparison_html(comparison, VERSION).encode()}
    if kind in {".svg", ".png", ".pdf"}:
        return {out: forest_bytes(comparison.rows, kind[1:])}
    return {out / name: content for name, content in site_files(comparison, VERSION).items()}
