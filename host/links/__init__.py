"""Links as chunks: the only place of the host that meets drivers.

A transport is found by the scheme of its URI and imported when it is opened, so that a missing driver of one kind never
blocks another. To add a kind of link, write a module with ``open_transport(uri: LinkUri) -> Transport``
and name it in :data:`SCHEMES`.
"""

from __future__ import annotations

import importlib
import threading
from functools import partial
from typing import cast

from host.errors import UsageError
from host.links.transport import AnyChunk, Chunk, FrameChunk, LinkEnd, Transport
from host.links.uri import EXAMPLES, LinkUri, parse_link_uri

__all__ = [
    "SCHEMES",
    "AnyChunk",
    "Chunk",
    "FrameChunk",
    "LinkEnd",
    "Transport",
    "open_lasting",
    "open_stoppable",
    "open_transport",
]

SCHEMES = {
    "serial": "host.links.serial.port",
    "can": "host.links.can.bus",
    "replay": "host.recording.replay_link",
}
"""Scheme of the link URI -> module with ``open_transport(uri)``."""


def open_transport(uri: LinkUri | str) -> Transport:
    """Open the link a URI names.

    Raises
    ------
    UsageError
        There is no such kind of link.
    LinkError, FileError
        It cannot be opened; the message has the reason and a remedy.
    """
    if isinstance(uri, str):
        uri = parse_link_uri(uri)
    if uri.scheme not in SCHEMES:
        raise UsageError(f"there is no kind of link called {uri.scheme!r}", f"write it like one of {EXAMPLES}")
    return cast(Transport, importlib.import_module(SCHEMES[uri.scheme]).open_transport(uri))


def open_stoppable(uri: str, stop: threading.Event | None = None) -> Transport:
    """Open the link a URI names within :data:`host.links.opening.OPEN_S`, or until ``stop``.

    Raises
    ------
    UsageError, LinkError, FileError
        As :func:`open_transport`; it did not open in time; it was stopped.
    """
    from host.links.opening import open_within

    return open_within(partial(open_transport, uri), str(parse_link_uri(uri)), stop)


def open_lasting(uri: str, give_up_s: float, stop: threading.Event | None = None) -> Transport:
    """Open the link a URI names, as :func:`open_stoppable`; a live one is opened again when it is lost.

    A lost link may take ``give_up_s`` seconds to come back; 0 does not wait.

    Raises
    ------
    UsageError, LinkError, FileError
        As :func:`open_stoppable`.
    """
    from host.links.reconnecting import ReconnectingTransport

    if parse_link_uri(uri).scheme == "replay":
        return open_transport(uri)
    return ReconnectingTransport(partial(open_transport, uri), give_up_s, opened=open_stoppable(uri, stop))
