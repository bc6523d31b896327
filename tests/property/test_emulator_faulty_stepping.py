"""A run with faults has the same faults and gives the same bytes, however its time is cut."""

from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st

from emulator.faults.definitions import FaultSettings, TimedFault
from emulator.injection import FaultInjector
from emulator.scenario import load_scenario
from emulator.virtual_object import VirtualObject
from firmware_protocol.packets import Start
from firmware_protocol.serial.decoder import StreamDecoder
from tests.memory_link import MemoryLink
from tests.sequence_oracle import counted

SCENARIO = replace(
    load_scenario("mute"),
    faults=FaultSettings(
        rates_from_s=0.5,
        drop_probability=0.05,
        duplicate_probability=0.05,
        reorder_probability=0.05,
        sign_flip_probability=0.1,
        wrong_norm_probability=0.02,
        bit_error_rate=1e-4,
        burst_probability=0.02,
        truncate_probability=0.02,
        garbage_probability=0.05,
        garbage_before_bytes=20,
        at=(
            TimedFault("stall", at_s=1.0, for_s=3.7),
            TimedFault("garbage", at_s=4.0),
            TimedFault("reset", at_s=5.123, for_s=0.2),
            TimedFault("unplug", at_s=6.0, for_s=0.5),
            TimedFault("clock-step", at_s=7.0, by_s=4.0),
            TimedFault("flood", at_s=7.5, for_s=0.7, factor=3.0),
            TimedFault("swap", at_s=8.5, for_s=0.1),
        ),
    ),
)


def a_run(cuts):
    link = MemoryLink()
    link.open()
    injector = FaultInjector(VirtualObject(SCENARIO, seed=4), link)
    for now_s in sorted({*cuts, 10.0}):
        injector.step(now_s)
        injector.receive(now_s)
    # Times are those of the step. Packets are treated in groups, so the order of byte and frame faults may differ.
    log = sorted(repr({k: v for k, v in e.items() if k != "time_s"}) for e in injector.truth()["faults"])
    return link.take(), log


REFERENCE = a_run([])


@settings(deadline=None, max_examples=25)
@given(st.lists(st.floats(0.0, 10.0), max_size=60))
def test_the_same_faults_and_bytes_for_any_stepping(cuts):
    assert a_run(cuts) == REFERENCE


@settings(deadline=None, max_examples=25)
@given(
    faults=st.lists(
        st.builds(
            TimedFault,
            kind=st.sampled_from(["stall", "unplug", "reset", "swap", "clock-step", "flood", "garbage"]),
            at_s=st.floats(0.0, 8.0),
            for_s=st.floats(0.0, 3.0),
            by_s=st.floats(-10.0, 10.0),
            factor=st.floats(0.1, 4.0),
            count=st.integers(1, 300),
        ),
        max_size=8,
    ),
    delivery_ms=st.sampled_from([0.0, 16.0]),
)
def test_any_mixture_of_timed_faults_ends_and_leaves_a_working_object(faults, delivery_ms):
    scenario = load_scenario("default")
    mixed = FaultSettings(at=tuple(faults), delivery_interval_ms=delivery_ms)
    link = MemoryLink()
    link.open()
    virtual = VirtualObject(replace(scenario, faults=mixed))
    injector = FaultInjector(virtual, link)
    link.put(Start(1))
    for k in range(160):
        injector.step(k * 0.1)
        injector.receive(k * 0.1)
    assert len([entry for entry in injector.log.entries if entry["kind"] != "lost-in-flight"]) == len(faults)
    assert len(virtual.firmware.boot_ids) >= 1
    # Everything is over by now: the object answers, and the whole of its answer arrives.
    link.take()
    link.put(Start(2))
    decoder, items = StreamDecoder(), []
    for now_s in (16.0, 16.2, 16.4, 16.6, 18.0):
        injector.step(now_s)
        injector.receive(now_s)
        items += decoder.feed(link.take())
    counters = decoder.counters
    assert counted(items)["sequence_gaps"] == 0
    assert counters.crc_errors == 0
    assert sum(counters.packets.values()) > 150
