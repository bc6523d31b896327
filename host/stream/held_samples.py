"""Who sends here, and the samples held back until that is known.

Two things put it in doubt: the link was opened again, and the clock jumped although the object did not report a reset.
Samples are then kept, and the object is asked. Its INFO decides::

    certain ──reopened, clock jumps──► holding ──INFO of the same object, or too long──► certain
       └──────────────────INFO of another object──────┴──► foreign ──INFO of the same object──┘
"""

from __future__ import annotations

import enum
from collections import deque

from firmware_protocol.items import StreamItem
from firmware_protocol.packets import Info, OrientationBatch

HELD_NS, MAX_HELD = 3_000_000_000, 10_000
"""How long, and how many, samples are held back until a reopened link's object reports who it is; then they count."""
DOUBT_NS = 300_000_000
"""How long samples are held back at least after a jump of the clock that nothing explains: a second object on the same
line, if there is one, has reported by then who it is."""
CROWDED_JUMPS = 4
CROWDED_NS = 2_000_000_000
"""So many jumps of the clock within so long are two objects that send in turn, or one that starts again and again."""


class Meeting(enum.Enum):
    """Who an INFO is of."""

    SAME = "the object, or the first"
    RESET = "the object, reset"
    ANOTHER = "another object"


class HeldSamples:
    """Knows the object, and keeps what may be another's."""

    def __init__(self) -> None:
        self.info: Info | None = None
        """The object as it last introduced itself."""
        self.crowded = False
        """Whether two objects send at once."""
        self._another = False  # another object answered last
        self._reopened = False  # since the object last introduced itself
        self._jumps_ns: deque[int] = deque(maxlen=CROWDED_JUMPS)
        self._items: list[tuple[StreamItem, int]] | None = None  # held back, and the reception of each
        self._n = 0
        self._wait_ns = HELD_NS
        self._doubts_clock = False

    @property
    def holding(self) -> bool:
        """Whether samples are held back now."""
        return self._items is not None

    @property
    def foreign(self) -> bool:
        """Whether another object sends now, or two at once."""
        return self._another or self.crowded

    @property
    def doubts_clock(self) -> bool:
        """Whether samples are held back because the clock jumped."""
        return self._doubts_clock and self.holding

    def reopened(self) -> None:
        """Note that the link was opened again: an object that has introduced itself must do so again."""
        self._reopened = True
        self.crowded = False
        self._jumps_ns.clear()
        if self.info is not None and not self.holding:
            self.start()

    def start(self, *, doubts_clock: bool = False) -> None:
        """Hold back what comes from now on."""
        self._items, self._n, self._wait_ns, self._doubts_clock = [], 0, HELD_NS, doubts_clock

    def hold(self, item: StreamItem, host_time_ns: int) -> bool:
        """Keep a packet; return whether that is now too many, or too long."""
        assert self._items is not None
        self._items.append((item, host_time_ns))
        self._n += len(item) if isinstance(item, OrientationBatch) else 1
        return self._n > MAX_HELD or host_time_ns - self._items[0][1] > self._wait_ns

    def release(self) -> list[tuple[StreamItem, int]]:
        """Return what was held back, with the reception of each, and hold back no more."""
        items, self._items = self._items or [], None
        return items

    def jumped(self, host_time_ns: int) -> None:
        """Count a jump of the clock that was believed: many in a row are two clocks."""
        self._jumps_ns.append(host_time_ns)
        if len(self._jumps_ns) == CROWDED_JUMPS and host_time_ns - self._jumps_ns[0] <= CROWDED_NS:
            self.crowded = True

    def meet(self, info: Info) -> Meeting:
        """Judge who an INFO is of. What another object's samples may be among is dropped."""
        known = self.info
        if known is not None and info.device_id != known.device_id:
            self._another, self._items = True, None
            # Behind an opening of the link it may have taken the object's place; without one, both are on the line.
            self.crowded = self.crowded or not self._reopened
            return Meeting.ANOTHER
        self._another = self._reopened = False
        self.info = info
        return Meeting.RESET if known is not None and info.boot_id != known.boot_id else Meeting.SAME

    def wait_for_another(self) -> bool:
        """After the object's own INFO: whether to wait on, because the jump may yet be a second object's.

        It is there; whether another one is too, it does not report.
        """
        if not self._items or not self._doubts_clock:
            return False
        self._wait_ns = DOUBT_NS
        return True
