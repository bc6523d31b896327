"""The virtual object in real time: when it says that a command came."""

import threading
import time
from dataclasses import replace

from emulator.device.clock import ClockSettings
from emulator.runner import run
from emulator.scenario import load_scenario
from firmware_protocol.packets import TimeReply, TimeRequest
from firmware_protocol.serial.decoder import StreamDecoder
from tests.memory_link import MemoryLink

SLOW_READ_S = 0.05


class SlowLink(MemoryLink):
    """A link on which a request is sent while the object, slow to look, is already reading."""

    virtual_time = False

    def __init__(self, stop):
        super().__init__()
        self._stop = stop
        self._reads = 0
        self.first_read_s = self.sent_s = 0.0

    def _read(self):
        self._reads += 1
        if self._reads == 1:
            self.first_read_s = time.monotonic()
        elif self._reads == 3:
            time.sleep(SLOW_READ_S)  # the machine is busy
            self.sent_s = time.monotonic()
            self.put(TimeRequest(9))
        elif self._reads > 4:
            self._stop.set()
        return super()._read()


def test_a_request_is_never_received_before_it_was_sent():
    stop = threading.Event()
    link = SlowLink(stop)
    perfect = replace(load_scenario("static"), clock=ClockSettings(skew_ppm=0.0, wander_ppm=0.0))
    run(perfect, link, duration_s=10.0, stop=stop)
    (reply,) = (item for item in StreamDecoder().feed(link.take()) if isinstance(item, TimeReply))
    # The object was powered up before the first read, so its clock shows at least the time since then.
    assert reply.receive_uptime_us >= 1e6 * (link.sent_s - link.first_read_s) - 1
    assert reply.transmit_uptime_us >= reply.receive_uptime_us
