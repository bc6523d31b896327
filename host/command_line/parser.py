"""The argument parser: one sentence with a remedy for every mistake, and the name that was probably meant."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from typing import NoReturn

from host.text import one_line

MAX_ECHO = 60
"""Characters of a wrong argument that a message repeats."""


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors look like all others: one sentence with a remedy, on stderr, exit code 2."""

    def error(self, message: str) -> NoReturn:
        """Print what is wrong with the arguments, and exit."""
        self.exit(2, f"rotdrift: {one_line(message)}; see `{self.prog} --help`\n")

    def refuse_unknown(self, words: list[str]) -> NoReturn:
        """Refuse what no option or argument of this command takes."""
        first = words[0].partition("=")[0]
        if first.startswith("-"):
            options = (name for name in self._option_string_actions if name.startswith("--"))
            self.error(f"there is no option {first[:MAX_ECHO]}{_guess(nearest(first, options))}")
        self.error(f"unexpected argument{'s' * (len(words) > 1)}: {' '.join(words)[:MAX_ECHO]}")

    def _check_value(self, action: argparse.Action, value: str) -> None:
        if action.choices is None or value in action.choices:
            return
        wrong, guess = value[:MAX_ECHO], _guess(nearest(value, action.choices))
        if isinstance(action, argparse._SubParsersAction):
            raise argparse.ArgumentError(None, f"there is no command {wrong!r}{guess}")
        listed = f" (choose {' or '.join(map(str, action.choices))})"
        raise argparse.ArgumentError(action, f"{wrong!r} is not possible{guess or listed}")


def _guess(name: str | None) -> str:
    return "" if name is None else f" (did you mean {name}?)"


def nearest(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that is nearest to a wrong one; None where none is near."""
    import difflib  # only where something is wrong

    return next(iter(difflib.get_close_matches(name, list(known), n=1)), None)
