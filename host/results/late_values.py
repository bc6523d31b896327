"""A mapping one of whose values is worked out only when somebody asks for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Generic, TypeVar

Value = TypeVar("Value")


class LateValues(Mapping[str, Value], Generic[Value]):
    """A mapping with one more value, made at its first use and kept.

    Parameters
    ----------
    values : mapping
        What is there already.
    name : str
        Key of the late value; it comes last.
    make : callable
        Makes it.
    """

    def __init__(self, values: Mapping[str, Value], name: str, make: Callable[[], Value]) -> None:
        self._values = dict(values)
        self._names = (*(key for key in values if key != name), name)
        self._values.pop(name, None)
        self._make = make

    def __getitem__(self, key: str) -> Value:
        """Give a value; the late one is made now, if it is it."""
        if key == self._names[-1] and key not in self._values:
            self._values[key] = self._make()
        return self._values[key]

    def __iter__(self) -> Iterator[str]:
        """Go through the keys; nothing is made."""
        return iter(self._names)

    def __len__(self) -> int:
        """Count the keys."""
        return len(self._names)

    def __contains__(self, key: object) -> bool:
        """Tell whether there is such a key; nothing is made."""
        return key in self._names
