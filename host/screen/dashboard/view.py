"""What the person at the terminal does with the picture: never part of the trial itself."""

from __future__ import annotations

from dataclasses import dataclass, field

from host.screen.dashboard.theme import Theme


@dataclass(frozen=True, slots=True)
class View:
    """Which object is in focus, what is being typed, in which theme."""

    theme: Theme = field(default_factory=Theme)
    focus: int = 0
    """Which of several objects is shown whole."""
    paused: bool = False
    """The picture stands still; the capture goes on."""
    help_open: bool = False
    prompt: str = ""
    """What is asked for while a person types; empty otherwise."""
    typed: str = ""
    """What was typed so far."""
    message: str = ""
    """Answer to the last key."""
