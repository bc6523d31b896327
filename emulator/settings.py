"""Settings with stated ranges: the rules of scenario keys, and how a TOML table becomes a frozen dataclass.

Each settings class declares its fields through :func:`number`, :func:`integer`, :func:`text`, :func:`choice`,
:func:`switch`, :func:`vector`, :func:`table` and :func:`tables`, and derives from :class:`Settings`; so a value is
checked in the same way whether it comes from a file or from code.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

from emulator import ScenarioError

S = TypeVar("S")

MAX_TEXT_BYTES = 200
MAX_TABLES = 100


@dataclass(frozen=True)
class _Number:
    low: float
    high: float
    whole: bool = False
    may_be_nan: bool = False

    @property
    def allowed(self) -> str:
        kind = "a whole number" if self.whole else "a number"
        low, high = (f"{int(end)}" if self.whole else f"{end:g}" for end in (self.low, self.high))
        return f"{kind} from {low} to {high}{', or nan' if self.may_be_nan else ''}"

    def accept(self, value: Any) -> float | int:  # noqa: ANN401
        allowed = f"must be {self.allowed}"
        if isinstance(value, bool) or not isinstance(value, int if self.whole else (int, float)):
            raise ScenarioError(f"{allowed}, not {value!r}")
        if self.may_be_nan and math.isnan(value):
            return math.nan
        if not self.low <= value <= self.high:  # also refuses NaN
            raise ScenarioError(f"{allowed}, not {value!r}")
        return int(value) if self.whole else float(value)


@dataclass(frozen=True)
class _Text:
    max_bytes: int

    @property
    def allowed(self) -> str:
        return f"printable text of at most {self.max_bytes} bytes"

    def accept(self, value: Any) -> str:  # noqa: ANN401
        if not isinstance(value, str) or len(value.encode()) > self.max_bytes or not value.isprintable():
            raise ScenarioError(f"must be {self.allowed}")
        return value


@dataclass(frozen=True)
class _Choice:
    names: tuple[str, ...]

    @property
    def allowed(self) -> str:
        return f"one of {', '.join(self.names)}"

    def accept(self, value: Any) -> str:  # noqa: ANN401
        if value not in self.names:
            raise ScenarioError(f"must be {self.allowed}, not {value!r}")
        return str(value)


@dataclass(frozen=True)
class _Switch:
    allowed = "true or false"

    def accept(self, value: Any) -> bool:  # noqa: ANN401
        if not isinstance(value, bool):
            raise ScenarioError(f"must be {self.allowed}, not {value!r}")
        return value


@dataclass(frozen=True)
class _Vector:
    length: int
    item: _Number
    unit: bool = False

    @property
    def allowed(self) -> str:
        if self.unit:
            return f"{self.length} numbers of length 1"
        return f"{self.length} numbers from {self.item.low:g} to {self.item.high:g}"

    def accept(self, value: Any) -> tuple[float, ...]:  # noqa: ANN401
        if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != self.length:
            raise ScenarioError(f"must be a list of {self.length} numbers, not {value!r}")
        numbers = tuple(float(self.item.accept(part)) for part in value)
        if self.unit:
            norm = math.sqrt(sum(part * part for part in numbers))
            if abs(norm - 1.0) > 1e-2:
                raise ScenarioError(f"must have length 1 within 0.01, not {norm:.4f}")
            numbers = tuple(part / norm for part in numbers)
        return numbers


@dataclass(frozen=True)
class _Table:
    cls: type[Any]
    many: bool

    @property
    def allowed(self) -> str:
        return "tables" if self.many else "a table"

    def accept(self, value: Any) -> Any:  # noqa: ANN401
        if not self.many:
            if not isinstance(value, self.cls):
                raise ScenarioError("must be a table")
            return value
        if not isinstance(value, Sequence) or len(value) > MAX_TABLES:
            raise ScenarioError(f"must be a list of at most {MAX_TABLES} tables")
        if not all(isinstance(part, self.cls) for part in value):
            raise ScenarioError("must be a list of tables")
        return tuple(value)


_Rule: TypeAlias = _Number | _Text | _Choice | _Switch | _Vector | _Table
"""Has ``allowed``, for people, and ``accept``, which returns a value in the field's type or raises ScenarioError."""


def _field(default: Any, rule: _Rule) -> Any:  # noqa: ANN401
    return dataclasses.field(default=default, metadata={"rule": rule})


def number(default: float, low: float, high: float, *, may_be_nan: bool = False) -> Any:  # noqa: ANN401
    """Declare a float field within [low, high]; ``may_be_nan`` also lets NaN stand for unknown."""
    return _field(float(default), _Number(low, high, may_be_nan=may_be_nan))


def integer(default: int, low: int, high: int) -> Any:  # noqa: ANN401
    """Declare an int field within [low, high]."""
    return _field(default, _Number(low, high, whole=True))


def text(default: str, max_bytes: int = MAX_TEXT_BYTES) -> Any:  # noqa: ANN401
    """Declare a field of printable text, at most ``max_bytes`` in UTF-8."""
    return _field(default, _Text(max_bytes))


def choice(default: str, *names: str) -> Any:  # noqa: ANN401
    """Declare a field that is one of the names."""
    return _field(default, _Choice(names))


def switch(default: bool) -> Any:  # noqa: ANN401
    """Declare a true/false field."""
    return _field(default, _Switch())


def vector(
    default: tuple[float, ...], low: float = -1e6, high: float = 1e6, *, unit: bool = False, may_be_nan: bool = False
) -> Any:  # noqa: ANN401
    """Declare a tuple of floats as long as the default; ``unit`` asks for length 1 within 0.01 and makes it exact."""
    return _field(default, _Vector(len(default), _Number(low, high, may_be_nan=may_be_nan), unit=unit))


def table(cls: type[Any]) -> Any:  # noqa: ANN401
    """Declare a field that is another settings class; absent means all its defaults."""
    return dataclasses.field(default_factory=cls, metadata={"rule": _Table(cls, many=False)})


def tables(cls: type[Any]) -> Any:  # noqa: ANN401
    """Declare a tuple of another settings class, from a TOML array of tables; absent means none."""
    return _field((), _Table(cls, many=True))


class Settings:
    """What the frozen dataclasses of settings have in common: each declared field is checked when one is made.

    Raises
    ------
    ScenarioError
        A value is of the wrong kind or out of range; names the key.
    """

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            rule: _Rule | None = field.metadata.get("rule")
            if rule is None:
                continue
            try:
                value = rule.accept(getattr(self, field.name))
            except ScenarioError as error:
                raise ScenarioError(f"{field.name} {error}") from None
            object.__setattr__(self, field.name, value)


def read_table(cls: type[S], data: Mapping[str, Any], where: str = "") -> S:
    """Return a settings dataclass, frozen and checked, from a parsed TOML table.

    ``where`` is the dotted name of the table, for messages; empty at the top.

    Raises
    ------
    ScenarioError
        An unknown key (names it and the nearest known one), or a value that is not allowed.
    """
    prefix = f"{where}." if where else ""
    rules = {field.name: field.metadata["rule"] for field in dataclasses.fields(cls) if "rule" in field.metadata}  # type: ignore[arg-type]
    values: dict[str, Any] = {}
    for key, value in data.items():
        if key not in rules:
            near = difflib.get_close_matches(key, rules, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"known keys: {', '.join(rules)}"
            raise ScenarioError(f"unknown key {prefix}{key!s}: {hint}")
        rule = rules[key]
        values[key] = _read_nested(rule, value, f"{prefix}{key}") if isinstance(rule, _Table) else value
    try:
        return cls(**values)
    except ScenarioError as error:
        raise ScenarioError(f"{prefix}{error}") from None


def _read_nested(rule: _Table, value: Any, where: str) -> Any:  # noqa: ANN401
    if not rule.many:
        if not isinstance(value, Mapping):
            raise ScenarioError(f"{where} must be a table: write [{where}]")
        return read_table(rule.cls, value, where)
    if not isinstance(value, list) or not all(isinstance(part, Mapping) for part in value):
        raise ScenarioError(f"{where} must be a list of tables: write [[{where}]]")
    if len(value) > MAX_TABLES:
        raise ScenarioError(f"{where} must be a list of at most {MAX_TABLES} tables, not {len(value)}")
    return tuple(read_table(rule.cls, part, where) for part in value)
