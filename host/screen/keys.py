"""From what a terminal sends to keys, and from keys to changes of the view and actions. No terminal in here."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from host.screen.dashboard.notices import EDITING
from host.screen.dashboard.theme import View
from host.text import plain
from host.trial.state import TrialState

MAX_TYPED = 200
ENTER, ESCAPE, BACKSPACE, SUSPEND, INTERRUPT, CLEAR = "\r", "\x1b", "\x7f", "\x1a", "\x03", "\x15"


@dataclass(frozen=True, slots=True)
class ScreenAction:
    """What a person asked for."""

    kind: str
    """``marker``, ``note``, ``window``, ``exclude``, ``include``, ``finish``, ``focus``, ``pause``, ``resume``,
    ``help``, ``aside``, ``back``, or ``close`` once the trial is finished."""
    index: int = 0
    """Which of several objects."""
    text: str = ""
    """What was typed."""
    cycle: int | None = None
    """Which cycle is meant, for ``exclude`` and ``include``."""


AT_ONCE = {
    "m": ("marker", "marker set"),
    "s": ("window", ""),
    "q": ("finish", "finishing"),
    INTERRUPT: ("finish", "finishing"),
}
"""Key -> the action that it is, and the answer to it."""


class KeyReader:
    """Turns keys into actions, and keeps the view."""

    def __init__(self, view: View) -> None:
        self.view = view
        self.aside = False
        """Whether the terminal is lent back to its owner for a while."""
        self._splitter = KeySplitter()
        self._asked = ""  # the action that waits for what is being typed
        self._cycle: int | None = None  # that it is about: the last on the screen when the key was pressed

    def press(self, text: str, states: tuple[TrialState, ...]) -> list[ScreenAction]:
        """Process what was typed since the last call, with these states on the screen; return what was asked for.

        The text is as the terminal sent it; special keys mean nothing, and a paste only where something is being typed.
        """
        keys, pasted = self._splitter.split(text)
        if self.aside:
            self.aside = not (keys or pasted)
            return [] if self.aside else [self._action("back")]
        if self.view.prompt and pasted:  # into a note, a paste goes as one line; elsewhere it means nothing
            typed = self.view.typed + plain(pasted, len(pasted) + 1)
            self.view = replace(self.view, typed=typed[:MAX_TYPED])
        actions = []
        for character in keys:
            key = ENTER if character == "\n" else BACKSPACE if character == "\b" else character
            action = self._typed(key) if self.view.prompt else self._key(key, states)
            if action is not None:
                actions.append(action)
        return actions

    def _typed(self, key: str) -> ScreenAction | None:
        view = self.view
        if key == ENTER:
            self.view = replace(view, prompt="", typed="")
            text = plain(view.typed, MAX_TYPED)
            return None if self._asked == "note" and not text else self._action(self._asked, text)
        if key in {ESCAPE, INTERRUPT}:
            self.view = replace(view, prompt="", typed="", message="nothing changed")
        elif key == BACKSPACE:
            self.view = replace(view, typed=view.typed[:-1])
        elif key == CLEAR:
            self.view = replace(view, typed="")
        elif key.isprintable() and len(view.typed) < MAX_TYPED:
            self.view = replace(view, typed=view.typed + key)
        return None

    def _key(self, key: str, states: tuple[TrialState, ...]) -> ScreenAction | None:
        focus = min(self.view.focus, len(states) - 1)
        self.view = replace(self.view, message="", focus=focus)
        state = states[focus]
        if all(other.score.finished for other in states):
            return self._action("close")
        if state.recording.replayed and key in EDITING:
            self.view = replace(self.view, message="a recording is only shown")
        elif key == "x":
            return self._exclude(state)
        elif key == "n":
            self._ask("note", "note")
        elif key in AT_ONCE:
            kind, answer = AT_ONCE[key]
            self.view = replace(self.view, message=answer)
            return self._action(kind)
        return self._screen_key(key, len(states))

    def _screen_key(self, key: str, n_objects: int) -> ScreenAction | None:
        view = self.view
        if key == "f" and n_objects > 1:
            self.view = replace(view, focus=(view.focus + 1) % n_objects)
            return self._action("focus")
        if key == "p":
            self.view = replace(view, paused=not view.paused)
            return self._action("resume" if view.paused else "pause")
        if key == "?":
            self.view = replace(view, help_open=not view.help_open)
            return None if view.help_open else self._action("help")
        if key == ESCAPE:
            self.view = replace(view, help_open=False)
        elif key == SUSPEND:
            self.aside = True
            return self._action("aside")
        return None

    def _exclude(self, state: TrialState) -> ScreenAction | None:
        row = state.score.cycles[-1] if state.score.cycles else None
        if row is None or row.number == 0:
            self.view = replace(self.view, message="no cycle yet")
            return None
        self._cycle = row.number
        if row.excluded:
            return self._action("include")
        self._ask("exclude", f"leave out cycle {row.number}, because")
        return None

    def _ask(self, kind: str, prompt: str) -> None:
        self._asked = kind
        self.view = replace(self.view, prompt=prompt, typed="")

    def _action(self, kind: str, text: str = "") -> ScreenAction:
        cycle = self._cycle if kind in {"exclude", "include"} else None
        return ScreenAction(kind, self.view.focus, text, cycle)


PASTE_ON, PASTE_OFF = "\x1b[?2004h", "\x1b[?2004l"
"""Ask the terminal to mark what is pasted; a terminal that does not know this ignores it."""
_PASTE_BEGINS, _PASTE_ENDS = "\x1b[200~", "\x1b[201~"
_SPECIAL = re.compile(r"\x1b(?:\[[0-?]*[ -/]*[@-~]|O.|[^\x1b\[O])", re.DOTALL)
_UNFINISHED = re.compile(r"\x1b(?:\[[0-?]*[ -/]*|O)\Z")
MAX_SEQUENCE = 64
"""A special key is never longer: what seems longer is not one."""


class KeySplitter:
    """Cuts what was read into single keys and pastes; a sequence may come in pieces."""

    def __init__(self) -> None:
        self._held = ""
        self._pasting = False

    def split(self, text: str) -> tuple[str, str]:
        """Return the characters typed (a lone ESC among them), and those pasted, of what was read."""
        text, self._held = self._held + text, ""
        keys: list[str] = []
        pasted: list[str] = []
        while text:
            if self._pasting:
                piece, end, text = text.partition(_PASTE_ENDS)
                self._pasting = not end
                if not end:  # its mark may come in pieces
                    cut = next((n for n in range(len(_PASTE_ENDS) - 1, 0, -1) if piece.endswith(_PASTE_ENDS[:n])), 0)
                    piece, self._held = piece[: len(piece) - cut], piece[len(piece) - cut :]
                pasted.append(piece)
                continue
            piece, escape, rest = text.partition("\x1b")
            keys.append(piece)
            text = escape + rest
            if not text:
                break
            special = _SPECIAL.match(text)
            if special is not None:
                self._pasting = special[0] == _PASTE_BEGINS
                text = text[special.end() :]
            elif _UNFINISHED.match(text) and len(text) < MAX_SEQUENCE:
                self._held, text = text, ""
            else:
                keys.append(text[0])
                text = text[1:]
        return "".join(keys), "".join(pasted)
