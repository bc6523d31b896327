"""Links as URIs: ``serial:/dev/ttyACM0?baud=1000000``, ``serial:socket://127.0.0.1:5000``, ``replay:trial.mcap``."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from urllib.parse import parse_qsl

from host.errors import UsageError

EXAMPLES = "serial:/dev/ttyACM0, serial:COM3, serial:socket://127.0.0.1:5000, can:socketcan:can0, replay:trial.mcap"


@dataclass(frozen=True, slots=True)
class LinkUri:
    """A link, parsed."""

    scheme: str
    """Which transport: ``serial``, ``can``, ``replay``."""
    target: str
    """What to open: a device path, a URL pyserial knows, ``INTERFACE:CHANNEL``, a file."""
    options: dict[str, str] = field(default_factory=dict)
    """What follows ``?``."""

    def __str__(self) -> str:
        query = "&".join(f"{key}={value}" for key, value in self.options.items())
        return f"{self.scheme}:{self.target}" + (f"?{query}" if query else "")

    def integer(self, name: str, default: int, minimum: int, maximum: int) -> int:
        """Return one option as a whole number.

        Raises
        ------
        UsageError
            Not a number, or outside [minimum, maximum].
        """
        text = self.options.get(name)
        if text is None:
            return default
        if not re.fullmatch(r"\d{1,12}", text) or not minimum <= int(text) <= maximum:
            raise UsageError(
                f"{name}={text} in the link {self} is not a whole number from {minimum} to {maximum}",
                f"leave it out ({default}) or give another",
            )
        return int(text)

    def allow_options(self, allowed: Iterable[str]) -> None:
        """Refuse options the transport does not know: a misspelt one must not be ignored.

        Raises
        ------
        UsageError
            There is another option; the known ones are listed.
        """
        known = sorted(allowed)
        for name in self.options:
            if name not in known:
                listed = ", ".join(known) or "none"
                raise UsageError(
                    f"the link {self} has the option {name}, which {self.scheme} links do not have",
                    f"options here: {listed}",
                )


def parse_link_uri(text: str) -> LinkUri:
    """Parse a link; a bare device path, COM port or pyserial URL means ``serial:``, a ``.mcap`` file ``replay:``.

    Raises
    ------
    UsageError
        Empty, or of a scheme that does not exist.

    Examples
    --------
    >>> parse_link_uri("serial:/dev/ttyACM0?baud=1000000")
    LinkUri(scheme='serial', target='/dev/ttyACM0', options={'baud': '1000000'})
    >>> parse_link_uri("COM3").scheme
    'serial'
    """
    text = text.strip()
    body, _, query = text.partition("?")
    scheme, colon, target = body.partition(":")
    if body.endswith(".mcap"):
        scheme, target = "replay", body.removeprefix("replay:")
    elif _is_bare_port(body):
        scheme, target = "serial", body
    elif not colon or not target:
        raise UsageError(f"{text or 'an empty text'} is not a link", f"write it like one of {EXAMPLES}")
    if scheme == "tcp":  # as `rotdrift emulate` writes it
        host_port = target if ":" in target else f"127.0.0.1:{target}"
        scheme, target = "serial", f"socket://{host_port}"
    elif scheme == "pty":
        scheme = "serial"
    return LinkUri(scheme, target, dict(parse_qsl(query, keep_blank_values=True)))


def _is_bare_port(body: str) -> bool:
    return bool(
        body.startswith(("/", "./", "\\\\.\\"))
        or re.fullmatch(r"COM\d{1,3}", body, re.IGNORECASE)
        or re.match(r"(socket|loop|rfc2217|spy|alt|hwgrep)://", body)
    )
