"""Many sessions of an object with its host, in virtual time: every fault of the emulator in random mixes, and values on
the wire that no object would send, with every checksum right.

A session is made from its seed alone. What comes of it live and from its recording is compared field by field.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from emulator.faults.definitions import FaultSettings, TimedFault
from emulator.injection import FaultInjector
from emulator.virtual_object import VirtualObject
from firmware_protocol import schema
from firmware_protocol.can.encoder import command_frame
from firmware_protocol.can.frames import CanFrame
from firmware_protocol.can.mapping import CanFunction, split_id
from firmware_protocol.codec import encode_packet
from firmware_protocol.errors import PacketValueError
from firmware_protocol.packets import PacketType
from firmware_protocol.serial.decoder import encode_command
from host.links.transport import AnyChunk, Chunk, FrameChunk
from host.recording.load import RecordedTrial, assemble
from host.results.parts import losses_per_cycle
from host.stream.blocks import STEPPED
from host.stream.session import Session, SessionSettings
from host.trial.live import Trial
from tests.can_traffic import answers
from tests.faulty_trials import SETTLE_S
from tests.joined_blocks import series_of
from tests.recorded_trials import MONOTONIC_NS, scenario
from tests.wire_oracle import NODE, CanSpy, SerialSpy

KINDS = ("serial", "can", "can-fd")
STEPS_S = (0.002, 0.01, 0.03)
INFO_RATE = 7
"""Place of the rate among the fields of INFO."""
MOST_PRODUCED = 12_000
"""In an account of a session: a few seconds at 100 Hz, with a flood in it, and what a wrong count may claim at most."""
VIEW_NS = 200_000_000
"""Between two looks at the account while the session runs, as a capture's screen has them."""
RATES = {
    "drop_probability": 0.1,
    "duplicate_probability": 0.05,
    "reorder_probability": 0.05,
    "zero_quaternion_probability": 0.02,
    "wrong_norm_probability": 0.02,
    "sign_flip_probability": 0.3,
    "command_loss_probability": 0.2,
}
DAMAGE = {
    "bit_error_rate": 5e-4,
    "burst_probability": 0.02,
    "truncate_probability": 0.02,
    "garbage_probability": 0.02,
}
TIMED = ("stall", "unplug", "reset", "swap", "second-object", "clock-step", "flood", "garbage")


@dataclass(frozen=True)
class MadeSession:
    """What a link delivered, and how it came about."""

    kind: str
    chunks: list[AnyChunk]
    faults: FaultSettings
    mutations: list[str]
    """What was changed on the wire, in order."""


def random_faults(rng: random.Random, kind: str, timed: Sequence[str] = TIMED) -> FaultSettings:
    """Return a mix of the emulator's faults."""
    names = RATES | (DAMAGE if kind == "serial" else {})
    rates = {name: rng.random() * limit for name, limit in names.items() if rng.random() < 0.4}
    if rng.random() < 0.3:
        rates |= {"delivery_interval_ms": rng.choice([1.0, 16.0, 30.0]), "delivery_jitter_ms": 10 * rng.random()}
    at = [
        TimedFault(name, at_s=rng.uniform(0.3, 4.0), for_s=rng.uniform(0.1, 2.0), by_s=rng.uniform(-3.0, 3.0))
        for name in timed
        if rng.random() < 0.2
    ]
    return FaultSettings(**rates, at=tuple(at))


class Mutator:
    """Changes packets and CAN frames as they are sent: one field to a value of an edge, or a packet's place."""

    def __init__(self, rng: random.Random, share: float) -> None:
        self._rng = rng
        self._share = share
        self._earlier: list[bytes] = []
        self.done: list[str] = []

    def packets(self, packets: Sequence[bytes]) -> list[bytes]:
        """Return what is sent in place of some packets."""
        sent: list[bytes] = []
        for packet in packets:
            self._earlier = [*self._earlier[-200:], packet]
            # There are a hundred samples to a STATUS.
            rare = packet[0] not in (PacketType.ORIENTATION, PacketType.RAW_IMU)
            if self._rng.random() >= self._share * (10 if rare else 1):
                sent.append(packet)
                continue
            what = self._rng.choice(["field"] * 6 + ["drop", "double", "swap", "splice"])
            self.done.append(f"{what} {PacketType(packet[0]).name}")
            if what == "field":
                sent.append(self._changed(packet))
            elif what == "double":
                sent += [packet, packet]
            elif what == "swap":
                sent.insert(max(0, len(sent) - 1), packet)
            elif what == "splice":
                sent += [packet, self._rng.choice(self._earlier)]
        return sent

    def _changed(self, packet: bytes) -> bytes:
        values = list(schema.parse(packet))
        places = [place for place, value in enumerate(values) if not isinstance(value, bytes)]
        if packet[0] == PacketType.ORIENTATION:
            places = [0, 1]  # a quaternion that is none is a fault of the emulator
        place = self._rng.choice(places)
        if packet[0] == PacketType.INFO:
            places.remove(INFO_RATE)  # one that cannot be has no form on CAN
        if packet[0] == PacketType.STATUS and self._rng.random() < 0.7:
            place = self._rng.choice([0, 2, 3])  # clock, samples produced, samples dropped
        for _ in range(20):
            changed = values.copy()
            changed[place] = self.number(int(changed[place])) if isinstance(changed[place], int) else 1e30
            try:
                packet = schema.build(PacketType(packet[0]), changed)
            except PacketValueError:
                continue
            self.done[-1] += f" {place}: {values[place]} -> {changed[place]}"
            return packet
        return packet

    def number(self, value: int) -> int:
        """Return another value of a number: an edge, or one not far away."""
        rng = self._rng
        edges = [0, 1, *(2**bits + off for bits in (7, 8, 15, 16, 31, 32, 53, 56, 62, 63, 64) for off in (-100, -1, 0))]
        if rng.random() < 0.4:
            return rng.choice(edges)
        return value + rng.choice([-1, 1]) * rng.choice([1, 2, 10, 300, 40_000, 10**6, 10**9, rng.randrange(2**32)])

    def frames(self, frames: Sequence[CanFrame]) -> list[CanFrame]:
        """Return what is sent in place of some CAN frames; whole packets are :meth:`packets`' own."""
        sent = []
        for frame in frames:
            identity = split_id(frame.arbitration_id)
            short = identity is not None and not identity.whole_packet and len(frame.data) == 8
            rare = identity is not None and identity.function is not CanFunction.ORIENTATION
            if not short or self._rng.random() >= self._share * (3 if rare else 0.3):
                sent.append(frame)
                continue
            assert identity is not None
            what = self._rng.choice(["field"] * 6 + ["drop", "double"])
            self.done.append(f"{what} frame {identity.function.name}")
            if what == "field":
                start, size = self._rng.choice([(0, 1), (0, 4), (4, 4), (1, 7), (5, 2), (7, 1)])
                old = int.from_bytes(frame.data[start : start + size], "little")
                new = self.number(old) % 256**size
                data = frame.data[:start] + new.to_bytes(size, "little") + frame.data[start + size :]
                sent.append(replace(frame, data=data))
                self.done[-1] += f" {start}+{size}: {old} -> {new}"
            elif what == "double":
                sent += [frame, frame]
        return sent


def made_session(seed: int, cycles: int = 1) -> MadeSession:
    """Return the session of a seed."""
    rng = random.Random(f"session {seed}")
    kind = KINDS[seed % len(KINDS)]
    faults = random_faults(rng, kind) if rng.random() < 0.7 else FaultSettings()
    mutator = Mutator(rng, rng.choice([0.0, 0.002, 0.02]) if faults != FaultSettings() else rng.choice([0.001, 0.02]))
    chosen = replace(scenario("ideal", motion={"cycles": cycles, "lead_in_s": 0.5, "lead_out_s": 0.5}), faults=faults)
    virtual = VirtualObject(chosen, seed)
    link = SerialSpy() if kind == "serial" else CanSpy(kind == "can-fd")
    send = link.send

    def changed(packets: Sequence[bytes]) -> int | None:
        return None if send(mutator.packets(packets)) is None else len(packets)

    link.send = changed
    if kind != "serial":
        put = link._put
        link._put = lambda frames: put(mutator.frames(frames))
    link.open()
    chunks = _delivered(virtual, link, kind, rng.choice(STEPS_S))
    return MadeSession(kind, chunks, faults, mutator.done)


def _delivered(virtual: VirtualObject, link: SerialSpy | CanSpy, kind: str, step_s: float) -> list[AnyChunk]:
    """Run an object with the host's session at the other end of its link; return what the link delivered."""
    injector, is_serial = FaultInjector(virtual, link), kind == "serial"
    host, encode = Trial(None if is_serial else NODE), encode_command if is_serial else encode_packet
    session = Session(SessionSettings(tries=20, handshake_s=2.0), link.host_uri, MONOTONIC_NS, encode)
    host.assembler.on_segment.append(session.new_segment)
    chunks: list[AnyChunk] = []
    step, was_there = 0, True
    while step * step_s < virtual.end_s + SETTLE_S and session.error is None:
        step += 1
        now_ns = MONOTONIC_NS + round(step * step_s * 1e9)
        link.at(now_ns)
        injector.step(step * step_s)
        injector.receive(step * step_s)
        injector.step(step * step_s)
        data = link.take()
        came: list[AnyChunk] = [Chunk(b"", now_ns)] if link.connected and not was_there else []
        if data:
            came.append(Chunk(data, now_ns) if is_serial else FrameChunk(data, now_ns))
        was_there = link.connected
        for chunk in came:
            chunks.append(chunk)
            if not chunk.data:
                session.reopened(now_ns)
            update = host.feed(chunk)
            session.feed(update.items, len(chunk.data), now_ns)
            if host.assembler.doubtful:
                session.ask_who(now_ns)
            if isinstance(chunk, FrameChunk):
                link.commands += answers(chunk.frames)
        for command in session.due(now_ns):
            if link.connected and is_serial:
                link.put_bytes(command)
            elif link.connected:
                link.commands.append(command_frame(command, NODE, link.fd))
        if host.problems:
            break
    return chunks


def live(session: MadeSession, view_ns: int = VIEW_NS) -> tuple[Trial, object]:
    """Feed a session into a trial as a capture does, chunk by chunk, with a look at the account now and then."""
    trial = Trial(None if session.kind == "serial" else NODE)
    blocks, viewed_ns = [], 0
    feed, release = trial.assembler.feed, trial.assembler.release

    def noted(found):
        blocks.extend(found)
        return found

    trial.assembler.feed = lambda *arguments: noted(feed(*arguments))
    trial.assembler.release = lambda: noted(release())
    for chunk in session.chunks:
        trial.feed(chunk)
        if view_ns and chunk.host_time_ns - viewed_ns >= view_ns:
            viewed_ns = chunk.host_time_ns
            trial.stream_view(viewed_ns)
    trial.finish()
    return trial, blocks


def wrong_with(session: MadeSession, view_ns: int = VIEW_NS) -> list[str]:
    """Return what is wrong with a session, a line each: what differs live and from its recording, sums, sizes."""
    trial, blocks = live(session, view_ns)
    recorded = assemble(session.chunks, "x", None if session.kind == "serial" else NODE)
    return [
        *_differing_fields(trial, recorded),
        *_differing_samples(blocks, recorded),
        *_wrong_account(recorded, sum(segment.reason != STEPPED for segment in recorded.segments)),
    ]


def _wrong_account(recorded: RecordedTrial, n_boots: int) -> list[str]:
    """Return where an account does not add up, or is larger than the object can have made it in this time."""
    losses, wrong = recorded.losses, []
    if losses.produced != losses.received + losses.lost + losses.rejected + losses.dropped:
        wrong.append(f"the sum is wrong: {losses}")
    if min(losses.lost, losses.rejected, losses.dropped, losses.duplicates, losses.reordered) < 0:
        wrong.append(f"a part is negative: {losses}")
    if losses.produced > MOST_PRODUCED * max(n_boots, losses.segments, 1):
        wrong.append(f"more than any object produces: {losses}")
    if len(recorded.series):
        edges = np.linspace(recorded.series.times_s[0], recorded.series.times_s[-1], 5).tolist()
        for cycle in losses_per_cycle(recorded, edges):
            if min(cycle.received, cycle.missing, cycle.rejected, cycle.dropped_by_device) < 0:
                wrong.append(f"a cycle's part is negative: {cycle}")
    return wrong


def _differing_fields(trial: Trial, recorded: RecordedTrial) -> list[str]:
    assembler, losses = trial.assembler, trial.assembler.losses()
    pairs = {
        "counters": (trial.link.counters, recorded.counters),
        "segments": (tuple(assembler.segments), recorded.segments),
        "info": (repr(assembler.info), repr(recorded.info)),
        "status": (repr(assembler.status), repr(recorded.status)),
        "problems": ({*trial.problems, *trial.refused}, set(recorded.problems)),
        "reconnects": (trial.reconnects, recorded.reconnects),
        "missing": (tuple(assembler.missing_runs()), recorded.missing),
    }
    pairs |= {f"losses.{name}": (getattr(losses, name), getattr(recorded.losses, name)) for name in FIELDS}
    return [f"{name}: live {one}, recorded {other}" for name, (one, other) in pairs.items() if one != other]


FIELDS = ("produced", "received", "lost", "rejected", "dropped", "duplicates", "reordered", "segments", "exact")


def _differing_samples(blocks, recorded: RecordedTrial) -> list[str]:
    if not blocks or not len(recorded.series):
        return [] if sum(map(len, blocks)) == len(recorded.series) else ["samples: one of both has none"]
    series = series_of(blocks, "x")
    return [
        f"samples: {column} differs"
        for column in ("index", "times_s", "quats_wxyz")
        if not np.array_equal(getattr(series, column), getattr(recorded.series, column))
    ]
