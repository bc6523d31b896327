"""Finding objects by listening: nothing is sent, so no other device is disturbed.

An object sends STATUS at least once a second, streaming or not. CAN adapters are opened in listen-only mode where they
have one, so that a wrong bit rate disturbs nobody; SocketCAN interfaces stay as they were set up.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import replace

from firmware_protocol.can.frames import CanFrame, FrameFlag
from firmware_protocol.can.mapping import ALL_NODES, CanFunction, split_id
from firmware_protocol.packets import Info, OrientationBatch, Status
from host.errors import HostError
from host.links import open_transport
from host.links.opening import OPEN_S
from host.links.transport import FrameChunk
from host.links.uri import parse_link_uri
from host.stream.decoding import Link

LISTEN_S = 2.0
_SENT_BY_OBJECTS = frozenset({CanFunction.STATUS, CanFunction.ORIENTATION, CanFunction.SAMPLE_STATE, CanFunction.TIME})


def objects_heard(link: str, listen_s: float = LISTEN_S) -> list[str]:
    """Return the links of the objects heard on a link, with their node ids on CAN; none where it does not open."""
    uri = parse_link_uri(link)
    if uri.scheme == "can":
        # On these, both kinds of frames are heard; elsewhere CAN FD would change how the adapter is set up.
        fd = uri.target.partition(":")[0] in {"socketcan", "virtual", "udp_multicast"}
        uri = replace(uri, options=uri.options | {"listen_only": "1"} | ({"fd": "1"} if fd else {}))
    nodes: dict[int, bool] = {}
    found = False
    try:
        with open_transport(uri) as transport:
            decoder = Link()
            deadline = time.monotonic() + listen_s
            while (left := deadline - time.monotonic()) > 0 and not (found and uri.scheme != "can"):
                chunk = transport.read(min(left, 0.1))
                if isinstance(chunk, FrameChunk):
                    for node, whole in filter(None, map(_object, chunk.frames)):
                        nodes[node] = nodes.get(node, False) or whole
                elif chunk is not None:
                    found |= any(isinstance(item, OrientationBatch | Status | Info) for item in decoder.feed(chunk))
    except HostError:
        pass
    if found:
        return [link]
    joint = "&" if "?" in link else "?"
    return [f"{link}{joint}node={node}{'&fd=1' * is_fd}" for node, is_fd in sorted(nodes.items())]


def objects_on(links: Sequence[str], listen_s: float = LISTEN_S) -> dict[str, list[str]]:
    """Return :func:`objects_heard` of several links, listening on all at the same time."""
    found: dict[str, list[str]] = {}

    def listen(link: str) -> None:
        found[link] = objects_heard(link, listen_s)

    threads = [threading.Thread(target=listen, args=(link,), daemon=True) for link in links]
    for thread in threads:
        thread.start()
    end_s = time.monotonic() + listen_s + OPEN_S  # for all of them
    for thread in threads:
        thread.join(max(0.0, end_s - time.monotonic()))
    return {link: found.get(link, []) for link in links}


def _object(frame: CanFrame) -> tuple[int, bool] | None:
    """Return the node id of the object that sent a frame, and whether it sends whole packets in CAN FD frames."""
    identity = split_id(frame.arbitration_id)
    if identity is None or frame.flags & (FrameFlag.EXTENDED | FrameFlag.REMOTE | FrameFlag.ERROR):
        return None
    whole_length = identity.whole_packet or len(frame.data) == 8
    ours = identity.function in _SENT_BY_OBJECTS and whole_length
    return (identity.node, identity.whole_packet) if ours and identity.node != ALL_NODES else None
