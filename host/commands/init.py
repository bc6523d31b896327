"""``rotdrift init``: make the object, hand and trial cards."""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from host.cards.definitions import Cards


@dataclass(frozen=True)
class Options:
    """The arguments of the command."""

    folder: str
    card: list[str] | None
    source: str | None
    template: bool
    schema: bool
    force: bool


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
        "--card", choices=("object", "hand", "trial"), action="append", help="only this card; may be given again"
    )
    parser.add_argument("--from", dest="source", metavar="FILE", help="take the values from a card file, ask nothing")
    parser.add_argument("--template", action="store_true", help="print a card file to fill in, and write nothing")
    parser.add_argument("--schema", action="store_true", help="print the JSON Schema of card files, and write nothing")
    parser.add_argument("--force", action="store_true", help="replace cards that exist")


def run(args: Options) -> int:
    """Ask, check, write ``object.toml``, ``hand.toml`` and ``trial.toml``.

    Raises
    ------
    UsageError
        There is no terminal to ask in.
    FileError
        A card is wrong, exists already, or cannot be written.
    """
    import json

    from host.cards import definitions as card_module
    from host.cards.questions import ask_for_cards, template
    from host.errors import UsageError

    if args.template or args.schema:
        schema = json.dumps(card_module.cards_schema(), indent=2, ensure_ascii=False) + "\n"
        sys.stdout.write(schema if args.schema else template())
        return 0
    folder = Path(args.folder)
    tables = tuple(table for table in card_module.TABLES if not args.card or table in args.card)
    if args.source:
        cards = card_module.load_cards(Path(args.source))
    elif not sys.stdin.isatty():
        raise UsageError(
            "there is no terminal to ask in", "give the values with --from FILE; `rotdrift init --template` prints one"
        )
    else:
        _refuse_existing(folder, tables, force=args.force)
        try:
            cards = ask_for_cards(_known(folder, tables), tables, input, print)
        except EOFError:
            print("\nnothing written")  # noqa: T201
            return 1
    _refuse_existing(folder, tables, force=args.force)
    written = _write(folder, cards, tables)
    missing = [field for field in card_module.missing_fields(cards) if field.split(".")[0] in tables]
    print(f"wrote {', '.join(str(path) for path in written)}")  # noqa: T201
    if missing:
        print(f"a complete submission also needs: {', '.join(missing)}")  # noqa: T201
    return 0


def _refuse_existing(folder: Path, tables: tuple[str, ...], *, force: bool) -> None:
    from host.errors import FileError

    for table in tables:
        if (folder / f"{table}.toml").exists() and not force:
            raise FileError(
                f"{folder / table}.toml exists already",
                "edit it, choose others with --card, or replace it with --force",
            )


def _known(folder: Path, tables: tuple[str, ...]) -> Cards:
    """Defaults: what the cards being replaced say."""
    from host.cards.definitions import Cards, load_cards, merged

    cards = Cards()
    for table in tables:
        path = folder / f"{table}.toml"
        if path.is_file():
            cards = merged(cards, load_cards(path))
    return cards


def _write(folder: Path, cards: Cards, tables: tuple[str, ...]) -> list[Path]:
    from host.cards.definitions import Cards, dump_cards
    from host.errors import unwritable

    written = []
    for table in tables:
        path = folder / f"{table}.toml"
        text = dump_cards(Cards(**{table: getattr(cards, table)}))
        try:
            folder.mkdir(parents=True, exist_ok=True)
            path.write_text(text or f"[{table}]\n", encoding="utf-8")
        except OSError as error:
            raise unwritable(path, error) from error
        written.append(path)
    return written
