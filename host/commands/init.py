"""``rotdrift init``: make the object, hand and trial cards of a submission."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from host.cards.definitions import Cards


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    parser = subparsers.add_parser(
        "init",
        help="make the object, hand and trial cards of a submission",
        description="Ask for the object, hand and trial cards in the terminal and write them as TOML.",
        epilog=(
            "example: rotdrift init trials/cube_roll\n"
            "then:    rotdrift report trials/cube_roll/*.mcap --out submission.zip"
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", nargs="?", default=".", metavar="FOLDER", help="where to write (default: here)")
    parser.add_argument(
        "--card", choices=("object", "hand", "trial"), action="append", help="only this card; may be repeated"
    )
    parser.add_argument("--from", dest="source", metavar="FILE", help="read the values from a card file, ask nothing")
    parser.add_argument("--template", action="store_true", help="print a card file to fill in, and write nothing")
    parser.add_argument("--schema", action="store_true", help="print the JSON Schema of card files, and write nothing")
    parser.add_argument("--force", action="store_true", help="replace cards that exist")


def run(args: argparse.Namespace) -> int:
    """Ask for the cards, check them, and write ``object.toml``, ``hand.toml`` and ``trial.toml``.

    Raises
    ------
    UsageError
        There is no terminal to ask in.
    FileError
        A card is wrong, exists already, or cannot be written.
    """
    import json

    from host.cards.definitions import TABLES, cards_schema, load_cards, missing_fields
    from host.cards.questions import ask_for_cards, template
    from host.errors import UsageError
    from host.output.lines import ask, write_line, write_lines, write_text

    if args.template or args.schema:
        schema = json.dumps(cards_schema(), indent=2, ensure_ascii=False) + "\n"
        write_text(schema if args.schema else template())
        return 0
    files = {table: Path(args.folder) / f"{table}.toml" for table in TABLES if not args.card or table in args.card}
    if args.source:
        cards = load_cards(Path(args.source))
    elif not sys.stdin.isatty():
        raise UsageError(
            "there is no terminal to ask in", "give the values with --from FILE; `rotdrift init --template` prints one"
        )
    else:
        _refuse_existing(files, force=args.force)  # before a person types all the answers
        try:
            cards = ask_for_cards(_existing(files), tuple(files), ask, write_line)
        except EOFError:
            write_lines(("", "nothing written"))
            return 1
    _refuse_existing(files, force=args.force)
    _write(cards, files)
    missing = [field for field in missing_fields(cards) if field.partition(".")[0] in files]
    write_line(f"wrote {', '.join(map(str, files.values()))}")
    if missing:
        write_line(f"a complete submission also needs: {', '.join(missing)}")
    return 0


def _refuse_existing(files: dict[str, Path], *, force: bool) -> None:
    from host.errors import already_there

    for path in files.values():
        if path.exists() and not force:
            raise already_there(path, "edit it, choose others with --card, or replace it with --force")


def _existing(files: dict[str, Path]) -> Cards:
    """Return the cards that will be replaced; their values are the defaults."""
    from host.cards.definitions import Cards, load_cards, merged

    cards = Cards()
    for path in files.values():
        if path.is_file():
            cards = merged(cards, load_cards(path))
    return cards


def _write(cards: Cards, files: dict[str, Path]) -> None:
    from host.cards.definitions import Cards, dump_cards
    from host.errors import unwritable

    for table, path in files.items():
        text = dump_cards(Cards(**{table: getattr(cards, table)}))
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text or f"[{table}]\n", encoding="utf-8")
        except OSError as error:
            raise unwritable(path, error) from error
