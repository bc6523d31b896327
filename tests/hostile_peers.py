"""Peers on loopback, and on pseudo-terminals, that are no objects: silent, closing, garbage, half an answer."""

from __future__ import annotations

import contextlib
import os
import random
import select
import socket
import threading
import tty
from collections.abc import Callable, Iterator

from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Info
from firmware_protocol.serial.framing import encode_frame

PEERS = ("silent", "closes", "busy", "garbage", "half an answer")
"""Accepts and sends nothing; accepts and closes; the same behind a sentence, as a serial server whose port is
taken; sends bytes without an end; starts an answer and sends no more."""
LINKS = {
    "tcp": "serial:socket://127.0.0.1:{port}",
    "rfc2217": "serial:rfc2217://127.0.0.1:{port}",
    "socketcand": "can:socketcand:127.0.0.1:{port}/can0",
    "slcan": "can:slcan:socket://127.0.0.1:{port}",
    "pty": "serial:{pty}",
    "slcan-pty": "can:slcan:{pty}",
}
_INFO = encode_frame(encode_packet(Info(device_id=1, boot_id=1)))
_HALVES = {"socketcand": b"< hi ><", "slcan": b"t1238", "slcan-pty": b"t1238"}
PAUSE_S = 0.02


@contextlib.contextmanager
def hostile_link(link: str, peer: str, accepted: list[object] | None = None) -> Iterator[str]:
    """Run a peer in a thread at the other end of a link; yield the link's URI. Of a server, note whom it accepts."""
    over = threading.Event()
    with contextlib.ExitStack() as stack:
        if "pty" in link:
            master, slave = os.openpty()
            tty.setraw(slave)
            stack.callback(os.close, slave)
            uri = LINKS[link].format(pty=os.ttyname(slave))
            run = threading.Thread(target=_behave_on_pty, args=(master, link, peer, over), daemon=True)
        else:
            server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
            uri = LINKS[link].format(port=server.getsockname()[1])
            run = threading.Thread(target=_serve, args=(server, link, peer, over, accepted), daemon=True)
        run.start()
        try:
            yield uri
        finally:
            over.set()
            run.join(10)


def _serve(server: socket.socket, link: str, peer: str, over: threading.Event, accepted: list[object] | None) -> None:
    """Accept clients one after the other, and behave towards each."""
    clients: list[socket.socket] = []
    while not over.is_set():
        ready, _, _ = select.select([server, *clients], [], [], PAUSE_S)
        for each in ready:
            with contextlib.suppress(OSError):
                if each is server:
                    client, address = server.accept()
                    if accepted is not None:
                        accepted.append(address)
                    client.setblocking(False)
                    clients.append(client)
                    if peer == "half an answer":
                        client.send(_half(link))
                elif not each.recv(4096):  # of a client that has gone
                    clients.remove(each)
                    each.close()
        if peer in ("closes", "busy"):
            for client in clients:
                with contextlib.suppress(OSError):
                    if peer == "busy":
                        client.send(b"Port already in use\r\n")
                client.close()
            clients.clear()
        elif peer == "garbage":
            for client in clients:
                with contextlib.suppress(OSError):
                    client.send(random.Random(1).randbytes(200))
    for client in clients:
        client.close()


def _behave_on_pty(master: int, link: str, peer: str, over: threading.Event) -> None:
    os.set_blocking(master, False)
    is_open, sent = True, False
    while not over.wait(PAUSE_S):
        if not is_open:
            continue
        with contextlib.suppress(OSError):
            os.read(master, 4096)
        data = b""
        if peer == "garbage":
            data = random.Random(1).randbytes(200)
        elif peer == "half an answer" and not sent:
            data = _half(link)
        elif peer == "busy" and not sent:
            data = b"Port already in use\r\n"
        if data:
            sent = True
            with contextlib.suppress(OSError):
                os.write(master, data)
        if peer in ("closes", "busy"):
            os.close(master)
            is_open = False
    if is_open:
        os.close(master)


def _half(link: str) -> bytes:
    return _HALVES.get(link, _INFO[: len(_INFO) // 2])


def in_thread(work: Callable[[], object]) -> threading.Thread:
    """Start work in a thread of its own."""
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    return thread
