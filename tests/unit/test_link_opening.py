"""Opening a link: within a limit, with a way out, and nothing that opens too late stays open."""

import threading

import pytest

from host.errors import LinkError, NoAnswerError, PortNotFoundError
from host.links.opening import open_within
from tests.memory_transport import MemoryTransport
from tests.waiting import wait_for, wait_for_event


class Blocking:
    """A driver that blocks as it opens, until it may go on."""

    def __init__(self):
        self.may_go_on = threading.Event()
        self.link = MemoryTransport()

    def open(self):
        wait_for_event(self.may_go_on, "the opening may go on")
        return self.link


def test_what_opens_is_returned_and_what_fails_is_raised():
    link = MemoryTransport()
    assert open_within(lambda: link, "memory:") is link
    assert not link.closed
    with pytest.raises(PortNotFoundError, match="no such port"):
        open_within(lambda: (_ for _ in ()).throw(PortNotFoundError("no such port")), "memory:")


def test_the_limit_holds_and_the_late_link_is_closed():
    driver = Blocking()
    with pytest.raises(NoAnswerError, match="memory: does not open within 0 s"):
        open_within(driver.open, "memory:", limit_s=0.1)
    driver.may_go_on.set()
    wait_for(lambda: driver.link.closed, "the late link is closed")


def test_a_stop_ends_the_waiting():
    driver, stop = Blocking(), threading.Event()
    threading.Timer(0.1, stop.set).start()
    with pytest.raises(LinkError, match="stopped before memory: was open"):
        open_within(driver.open, "memory:", stop, limit_s=1000.0)
    driver.may_go_on.set()
    wait_for(lambda: driver.link.closed, "the late link is closed")
