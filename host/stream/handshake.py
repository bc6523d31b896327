"""The first question to an object: who is there? Or why it must be that nobody is."""

from __future__ import annotations

import enum

from host.errors import NoAnswerError


class Found(enum.Enum):
    """What a handshake has come to."""

    WAITING = "no answer yet"
    ASK = "no answer yet, and it is time to ask again"
    MUTE = "an object that streams, but never answers"
    NOBODY = "no answer within the time for it"


class Handshake:
    """Waits for an object on a link; the times are those of :class:`host.stream.session.SessionSettings`."""

    def __init__(self, link_name: str, now_ns: int, limit_s: float, answer_s: float, mute_s: float) -> None:
        self._link_name = link_name
        self._limit_s = limit_s
        self._answer_s = answer_s
        self._mute_s = mute_s
        self._start_ns = now_ns
        self._asked_ns: int | None = None
        self._first_sample_ns: int | None = None
        self._n_bytes = 0
        self._patient = False  # an object that was captured before may be silent for as long as the caller waits

    def restart(self, now_ns: int, *, patient: bool) -> None:
        """Start again: the link was opened again. An object that was never heard has no new time for it."""
        if patient:
            self._start_ns = now_ns
        self._patient = patient
        self._asked_ns = self._first_sample_ns = None

    def heard(self, n_bytes: int) -> None:
        """Note bytes that came, whatever they mean."""
        self._n_bytes += n_bytes

    def sampled(self, host_time_ns: int) -> None:
        """Note a sample."""
        if self._first_sample_ns is None:
            self._first_sample_ns = host_time_ns

    def judge(self, now_ns: int) -> Found:
        """Return what the handshake has come to; ASK counts as asked."""
        if self._first_sample_ns is not None and now_ns - self._first_sample_ns > self._mute_s * 1e9:
            return Found.MUTE
        late = now_ns - self._start_ns > self._limit_s * 1e9
        if late and self._first_sample_ns is None and not self._patient:
            return Found.NOBODY
        if self._asked_ns is None or now_ns - self._asked_ns >= self._answer_s * 1e9:
            self._asked_ns = now_ns
            return Found.ASK
        return Found.WAITING

    def error(self) -> NoAnswerError:
        """Return why nobody can be captured here."""
        name, seconds = self._link_name, f"{self._limit_s:.0f} s"
        if name.startswith("can:"):
            heard = "frames came, but no sample and no answer" if self._n_bytes else "no frame came"
            return NoAnswerError(
                f"nothing answers at {name}: {heard} within {seconds}",
                "check node id, bit rate and fd in the link, and that the object is switched on; "
                "`rotdrift ports --probe` lists the objects on a bus",
            )
        if self._n_bytes:
            return NoAnswerError(
                f"{name} sends bytes ({self._n_bytes} in {seconds}), but nothing an object would send",
                "check the baud rate (?baud=) and whether another device is at this port",
            )
        return NoAnswerError(
            f"nothing answers at {name} and no data came within {seconds}",
            "check that the object is switched on and that this is its port (`rotdrift ports`)",
        )
