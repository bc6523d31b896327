"""A virtual object, its link, and what goes wrong between them.

The injector stands between firmware and link for every run; without faults it only counts what is sent. Steps are split
at the instants of timed faults, so that a run has the same faults however it is stepped.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from emulator.device.firmware import Firmware
from emulator.faults.definitions import FaultLog, FaultSettings, LiveFault, RateChange, TimedFault
from emulator.faults.frame_faults import ByteFaults
from emulator.injection.agenda import Agenda
from emulator.injection.delivery import Delivery
from emulator.links import Link
from emulator.links.byte_stream import ByteLink
from emulator.second_object import second_object
from emulator.virtual_object import VirtualObject
from firmware_protocol.packets import PacketType

_COMMAND_STREAM = 54
_UNPLUGGING = ("unplug", "swap")
_ENDING = (*_UNPLUGGING, "stall", "flood", "second-object")
"""Faults that are over after their ``for_s``; the others are for the object itself to end."""


class FaultInjector:
    """Runs a virtual object on an open link, with the faults of its scenario."""

    def __init__(self, virtual_object: VirtualObject, link: Link) -> None:
        self._object, self._firmware, self._link = virtual_object, virtual_object.firmware, link
        self._settings = virtual_object.scenario.faults
        seed = virtual_object.seed
        self.log = FaultLog()
        """Every fault that happened."""
        self._delivery = Delivery(link, self._settings, seed, self.log)
        self._byte_faults = ByteFaults(self._settings, seed, self.log)
        self._command_rng = np.random.default_rng([seed, _COMMAND_STREAM])
        self._second: Firmware | None = None
        self._agenda = Agenda()
        self._is_planned = False  # the scenario's own faults
        self._under_way: Counter[str] = Counter()  # faults of one kind may overlap
        self._rate_changes = 0
        self._now_s = 0.0
        self._use(self._settings)

    # --- time ----------------------------------------------------------------------------------------------------

    def step(self, now_s: float) -> None:
        """Do all that is due by now; times never decrease."""
        self._plan_scenario()
        while (due := self._agenda.take_due(now_s)) is not None:
            time_s, action = due
            self._step_to(time_s)
            action()
        self._step_to(now_s)

    def _step_to(self, now_s: float) -> None:
        # With a second object on the line they take turns, in the order in which they have something to send.
        while self._second is not None and (due_s := min(self._firmware.next_due_s, self._second.next_due_s)) < now_s:
            self._step_both(due_s)
        self._step_both(now_s)

    def _step_both(self, now_s: float) -> None:
        self._now_s = self._byte_faults.now_s = max(now_s, self._now_s)
        self._firmware.step(self._now_s, self._send)
        if self._second is not None:
            self._second.step(self._now_s, self._send_second)
        if not self._under_way["stall"]:
            self._delivery.deliver(self._now_s)

    @property
    def next_due_s(self) -> float:
        """When :meth:`step` has something to do next, if no command comes, s."""
        second_s = math.inf if self._second is None else self._second.next_due_s
        return min(self._firmware.next_due_s, second_s, self._agenda.next_due_s, self._delivery.next_due_s)

    @property
    def backlog(self) -> int:
        """Packets that wait because the link accepts nothing."""
        return self._firmware.backlog + (self._delivery.next_due_s <= self._now_s)

    def _plan_scenario(self) -> None:
        """Put the scenario's faults into time once the hand's timeline has started."""
        start_s = self._object.hand_start_s
        if self._is_planned or start_s is None:
            return
        self._is_planned = True
        self._agenda.plan(start_s + self._settings.rates_from_s, partial(self._set_rates, active=True))
        self._agenda.plan(start_s + self._settings.rates_until_s, partial(self._set_rates, active=False))
        for fault in self._settings.at:
            self._agenda.plan(start_s + fault.at_s, partial(self._start, fault))

    def inject(self, fault: LiveFault) -> None:
        """Let a fault happen at the next step, whatever its ``at_s``: a live command."""
        action = partial(self._change_rates, fault) if isinstance(fault, RateChange) else partial(self._start, fault)
        self._agenda.plan(self._now_s, action)

    # --- commands and packets ------------------------------------------------------------------------------------

    def receive(self, now_s: float) -> None:
        """Pass on the commands that have arrived, after :meth:`step` up to now."""
        self.obey(self.collect(), now_s)

    def collect(self) -> list[bytes]:
        """Return the commands that have arrived on the link, without doing anything with them."""
        return self._link.receive() if not self._under_way["unplug"] else []

    def obey(self, commands: Sequence[bytes], now_s: float) -> None:
        """Pass commands on to the object, after :meth:`step` up to now."""
        for command in commands:
            chance = self._settings.command_loss_probability
            if chance and self._command_rng.random() < chance:
                self.log.add("command-loss", now_s, command_type=command[0] if command else None)
            else:
                self._firmware.receive(command, now_s)
                if self._second is not None:
                    self._second.receive(command, now_s)

    def _send(self, packets: Sequence[bytes]) -> int | None:
        """Accept packets from the firmware: the sink of its queue."""
        if self._under_way["unplug"]:
            return None
        if self._under_way["stall"]:
            return 0
        return self._delivery.send(packets, self._now_s, faulty=self._byte_faults.active)

    def _send_second(self, packets: Sequence[bytes]) -> int | None:
        """Accept packets from a second object; nothing happens to them on the way."""
        if self._under_way["unplug"]:
            return None
        if self._under_way["stall"] or self._delivery.next_due_s < math.inf:
            return 0
        return self._link.send(packets)

    # --- rates ---------------------------------------------------------------------------------------------------

    def _set_rates(self, *, active: bool) -> None:
        self._byte_faults.active = active

    def _use(self, settings: FaultSettings) -> None:
        self._settings = settings
        self._delivery.use(settings)
        self._byte_faults.use(settings)
        if isinstance(self._link, ByteLink) and self._byte_faults.any:
            self._link.tamper = self._byte_faults

    def _change_rates(self, change: RateChange) -> None:
        """Set rates while the object runs; the latest change counts."""
        was_active = self._byte_faults.active
        self._rate_changes += 1
        self._use(change.apply(self._object.scenario.faults))
        self._set_rates(active=True)
        details: dict[str, Any] = dict(change.values)
        self.log.add("rates", self._now_s, **details)
        if change.for_s < math.inf:
            self._agenda.plan(self._now_s + change.for_s, partial(self._restore_rates, self._rate_changes, was_active))

    def _restore_rates(self, number: int, active: bool) -> None:
        if number == self._rate_changes:
            self._use(self._object.scenario.faults)
            self._set_rates(active=active)

    # --- timed faults --------------------------------------------------------------------------------------------

    def _start(self, fault: TimedFault) -> None:
        now_s, firmware = self._now_s, self._firmware
        details: dict[str, Any] = {"for_s": fault.for_s}
        match fault.kind:
            case "stall":
                self._under_way["stall"] += 1
            case "unplug":
                self._unplug()
            case "reset":
                firmware.reset(now_s, fault.for_s)
            case "swap":
                self._unplug()
                firmware.become_another(now_s, fault.for_s)
                details["device_id"] = firmware.settings.device_id
            case "wrong-version":
                firmware.speak_version(fault.major, now_s, fault.for_s)
                details["major"] = fault.major
            case "second-object":
                self._second = second_object(self._object, now_s)
                details["device_id"] = self._second.settings.device_id
            case "clock-step":
                firmware.step_clock(now_s, round(fault.by_s * 1e6))
                details = {"by_s": fault.by_s}
            case "flood":
                self._under_way["flood"] += 1
                firmware.set_true_rate(max(round(firmware.rate_hz * fault.factor), 1), now_s)
                details["factor"] = fault.factor
            case "garbage":
                if not isinstance(self._link, ByteLink):
                    return
                self._link.inject(self._byte_faults.garbage(fault.count))
                details = {"count": fault.count}
        self.log.add(fault.kind, now_s, **details)
        if fault.kind in _ENDING:
            self._agenda.plan(now_s + fault.for_s, partial(self._end, fault))

    def _end(self, fault: TimedFault) -> None:
        if fault.kind == "second-object":
            self._second = None
            return
        kind = "unplug" if fault.kind in _UNPLUGGING else fault.kind
        self._under_way[kind] -= 1
        if kind == "flood" and not self._under_way[kind]:
            self._firmware.set_true_rate(self._firmware.rate_hz, self._now_s)
        elif kind == "unplug" and not self._under_way[kind]:
            self._link.replug()

    def _unplug(self) -> None:
        if not self._under_way["unplug"]:
            self._link.unplug()
            self._delivery.lose(self._now_s)
        self._under_way["unplug"] += 1

    # --- truth ---------------------------------------------------------------------------------------------------

    def truth(self) -> dict[str, Any]:
        """Return what was sent and what went wrong, ready for JSON."""
        return {
            "sent": {PacketType(kind).name: count for kind, count in sorted(self._delivery.sent.items())},
            "frames_damaged": dict(sorted(self._byte_faults.damaged.items())),
            "fault_counts": dict(sorted(self.log.counts.items())),
            "faults": list(self.log.entries),
        }
