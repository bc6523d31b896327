"""A view never ends what it watches: what only watches a capture is used until its first failure, and never after it.

Recording, decoding and ledger stand below and are not guarded: where they fail, nothing above them can be trusted.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Generic, TypeVar

from host.text import plain

T = TypeVar("T")
R = TypeVar("R")


class Guarded(Generic[T]):
    """A part that may fail alone: cycle detector, clock estimate, screen, alarms, ...

    Parameters
    ----------
    name : str
        Of the part, as its failure is reported: "the alarms".
    subject : T
        The part itself.
    failures : list of str
        Where the sentence on its failure goes; parts of one capture share it.
    consequence : str
        What a person has to do without from then on.
    """

    def __init__(self, name: str, subject: T, failures: list[str], consequence: str) -> None:
        self.subject = subject
        """For what cannot fail, its plain attributes; everything else goes through :meth:`ask`."""
        self.works = True
        """Whether it has not failed yet."""
        self._name = name
        self._failures = failures
        self._consequence = consequence

    def ask(self, use: Callable[[T], R], otherwise: R) -> R:
        """Return what the part makes of it; ``otherwise`` where it fails now, or has failed before.

        Ctrl-C and the end of the program are no failures, and pass.
        """
        if not self.works:
            return otherwise
        try:
            return use(self.subject)
        except Exception as error:  # noqa: BLE001 - whatever a view does wrong, the capture goes on
            self.works = False
            self._failures.append(f"{self._name} failed ({cause(error)}) and is switched off: {self._consequence}")
            return otherwise


def cause(error: BaseException) -> str:
    """Return what an error is and where it was raised, for a report: ``ValueError: no sample, at rate.py:31``."""
    raised = traceback.extract_tb(error.__traceback__)[-1:]
    place = "".join(f", at {Path(frame.filename).name}:{frame.lineno}" for frame in raised)
    return plain(f"{type(error).__name__}: {error}", 200) + place
