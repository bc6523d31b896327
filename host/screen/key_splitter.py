"""What a terminal sends, cut into keys: special keys and mouse reports mean nothing, a paste is no typing."""

from __future__ import annotations

import re

PASTE_ON, PASTE_OFF = "\x1b[?2004h", "\x1b[?2004l"
"""Ask the terminal to say what is pasted; a terminal that does not know this ignores it."""
_PASTE_BEGINS, _PASTE_ENDS = "\x1b[200~", "\x1b[201~"
_SPECIAL = re.compile(r"\x1b(?:\[[0-?]*[ -/]*[@-~]|O.|[^\x1b\[O])", re.DOTALL)
_UNFINISHED = re.compile(r"\x1b(?:\[[0-?]*[ -/]*|O)\Z")
MAX_SEQUENCE = 64
"""A special key is never longer: what looks longer is none."""


class KeySplitter:
    """Cuts what was read into single keys and pastes; a sequence may come in pieces."""

    def __init__(self) -> None:
        self._held = ""
        self._pasting = False

    def split(self, text: str) -> tuple[str, str]:
        """Take what was read.

        Parameters
        ----------
        text : str
            As it came.

        Returns
        -------
        keys, pasted : str
            Characters typed (a lone ESC among them), and characters pasted.
        """
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
