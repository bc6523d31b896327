"""Faults injected into a program without changing it: a function that was called raises in place of running, once.

The calls are found by watching one run, so a call that is added later is found as well.
"""

import sys
from collections import Counter
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent


@dataclass(frozen=True, order=True)
class Call:
    """One place in the program that calls one function of a part."""

    part: str
    file: str
    """Of the function, from the root of the repository."""
    function: str
    caller: str
    """File and line."""

    def __str__(self):
        return f"{self.file}:{self.function} called at {self.caller}"


def _known(part_of):
    """Return what knows the file and part of a code object, and remembers them: the profiler asks at every call."""
    known = {}

    def asked(code):
        found = known.get(code)
        if found is None:
            path = Path(code.co_filename)
            file = str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else ""
            known[code] = found = (file, part_of(file, code.co_qualname) if file else None)
        return found

    return asked


def _calls(part_of, seen):
    """Return a profiler that reports each call into a part from outside of it."""
    asked = _known(part_of)

    def profile(frame, event, _):
        if event != "call" or frame.f_back is None:
            return
        code, caller = frame.f_code, frame.f_back.f_code
        file, part = asked(code)
        if part is not None and not code.co_name.startswith("<"):  # a lambda belongs to who wrote it
            caller_file, caller_part = asked(caller)
            if caller_part != part and caller_file:
                seen(Call(part, file, code.co_qualname, f"{caller_file}:{frame.f_back.f_lineno}"))

    return profile


@contextmanager
def calls_counted(part_of):
    """Count the calls into parts, while this is open, by where they are made.

    ``part_of`` is asked with the file of a function and its qualified name; None where it is of no part.
    """
    counts = Counter()
    before = sys.getprofile()
    sys.setprofile(_calls(part_of, lambda call: counts.update((call,))))
    try:
        yield counts
    finally:
        sys.setprofile(before)


@contextmanager
def raising(part_of, chosen, number, error):
    """Have one call, the ``number``-th of its kind (from 1), raise ``error``: Python stops profiling then."""
    n, before = 0, sys.getprofile()

    def seen(call):
        nonlocal n
        n += call == chosen
        if n == number and call == chosen:
            raise error

    calls, name = _calls(part_of, seen), chosen.function.rpartition(".")[2]
    # Most calls are of other names: to look no further halves the time of a run.
    sys.setprofile(lambda frame, event, arg: frame.f_code.co_name == name and calls(frame, event, arg))
    try:
        yield
    finally:
        sys.setprofile(before)
