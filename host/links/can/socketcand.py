"""python-can's socketcand bus, noticing that the server is gone, or was never there.

When the server closes the connection, the library's reading returns nothing at once, for ever, and ``recv`` spins on it
until its time is over. Where no server is, its opening spins for 10 s and leaves the socket open; where one accepts and
is silent, it waits for ever; and of a greeting that comes in two pieces it sees the first.
"""

from __future__ import annotations

import socket
import time
from typing import Any

import can
from can.interfaces.socketcand import SocketCanDaemonBus

EMPTY_READS = 20
"""So many reads in a row that return nothing at once: the connection is gone."""
CONNECT_S = 2.0
ANSWER_S = 2.0
"""How long each of the server's three answers may take."""
SEND_S = 0.5
"""A server that accepts no frame for so long is gone."""
MAX_ANSWER_BYTES = 256


class WatchedSocketcandBus(SocketCanDaemonBus):
    """A bus served by socketcand.

    Parameters
    ----------
    channel : str
        Name of the bus at the server.
    host, port : str, int
        The server.
    **options : object
        Those of ``can.BusABC``.

    Raises
    ------
    OSError
        No server is there.
    can.CanError
        It does not have the bus; reading raises it too when the server has gone.
    """

    _empty_reads = 0

    def __init__(self, channel: str, host: str, port: int, **options: Any) -> None:  # noqa: ANN401
        socket.create_connection((host, port), CONNECT_S).close()
        try:
            super().__init__(channel, host, port, **options)  # type: ignore[no-untyped-call]
            self._connection.settimeout(SEND_S)  # of sending: what is received has been waited for
        except BaseException:
            left = self.__dict__.get("_SocketCanDaemonBus__socket")
            if left is not None:
                left.close()
            raise

    @property
    def _connection(self) -> socket.socket:
        connection: socket.socket = self.__dict__["_SocketCanDaemonBus__socket"]  # the library has no other name for it
        return connection

    def _expect_msg(self, msg: str) -> None:
        """Wait for an answer of the server; called by the library's constructor."""
        end_s, answer = time.monotonic() + ANSWER_S, b""
        while not answer.endswith(b">") and len(answer) < MAX_ANSWER_BYTES:
            self._connection.settimeout(max(0.001, end_s - time.monotonic()))
            try:
                piece = self._connection.recv(1)  # not a byte of what follows the answer
            except TimeoutError as error:
                raise TimeoutError(f"no {msg} within {ANSWER_S:.0f} s, but {answer!r}") from error
            if not piece:
                raise can.CanError(f"the server closed the connection in place of {msg}")
            answer += piece
        if answer != msg.encode():
            raise can.CanError(f"expected {msg}, got {answer!r}")

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        started = time.monotonic()
        message, filtered = super()._recv_internal(timeout)  # type: ignore[no-untyped-call]
        waits = timeout is None or timeout > 0.002
        if message is not None or (waits and time.monotonic() - started > 0.001):
            self._empty_reads = 0
        elif waits:
            self._empty_reads += 1
            if self._empty_reads >= EMPTY_READS:
                raise can.CanOperationError("the server closed the connection")
        return message, filtered
