"""A virtual sensorized object: known true drift, real wire, faults on demand.

Everything here is a pure function of given time and seed, but for :mod:`emulator.runner` and :mod:`emulator.links`,
which meet the clock and the operating system. Errors, one tree::

    EmulatorError        as it is: the truth or a byte file cannot be written (names the file)
    ├── ScenarioError    a scenario is unknown, not TOML, or a value in it is out of range (names the key)
    └── LinkError        a link cannot be opened: bad URI, port or path in use (with a remedy)
"""

from __future__ import annotations

__all__ = ["EmulatorError", "LinkError", "ScenarioError"]


class EmulatorError(Exception):
    """Base of everything this package raises on purpose; the message is one sentence for a person."""


class ScenarioError(EmulatorError):
    """A scenario that cannot be: the message names the table, the key and what is allowed."""


class LinkError(EmulatorError):
    """A link that cannot be opened; the message has the reason and a remedy."""
