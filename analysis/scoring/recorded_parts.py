"""The parts of a result that come from a recording of ours: object, link, losses, clock, operator. The host fills them.

Names, order and units as in :mod:`analysis.scoring.result_parts`.
"""

from __future__ import annotations

from analysis.scoring.result_parts import Known, Part


class Losses(Part, frozen=True, kw_only=True):
    """The account of all samples; ``produced == received + lost + rejected + dropped_by_device + damaged_in_file``."""

    produced: int
    """Samples that the object made, by their numbers."""
    received: int
    """Of these, samples that are here."""
    lost: int
    """On the link."""
    rejected: int
    """Arrived damaged."""
    duplicates: int
    """Samples that came again; not part of the sum."""
    reordered: int
    """Received samples that came late; part of ``received``."""
    segments: int
    """One, and one more for each reset of the device or step of its clock."""
    exact: bool
    """Whether the division between lost and dropped is the device's own."""
    dropped_by_device: int
    """Those that the object dropped itself, by its own count."""
    missing: int
    """Samples that were produced and are not here."""
    share: float
    """Missing samples as a share of those produced, 0-1."""
    damaged_in_file: int = 0
    """In records that the recording lacks; absent where there are none."""


class CycleLosses(Part, frozen=True, kw_only=True):
    """The account of one cycle."""

    produced: int
    """Samples of the cycle, by their numbers."""
    missing: int
    """Of these, samples that are not here."""
    rejected: int
    """Of the missing, those that arrived damaged."""
    dropped_by_device: int
    """Of the missing, those that the device dropped."""
    received: int
    """Of these, samples that are here."""
    lost: int
    """Of the missing, those lost on the link."""
    damaged_in_file: int = 0
    """Of the missing, those in records that the recording lacks; absent where there are none."""


class Quality(Part, frozen=True):
    """What the losses of one trial come to."""

    degraded: bool
    """Whether more is missing than a good trial may miss. The score stands all the same."""
    reasons: tuple[str, ...]
    """Why, a sentence each; empty where nothing is degraded."""
    cycles_with_gaps: tuple[int, ...]
    """Cycles, from 1, that miss more than the second limit."""
    limits: tuple[float, float, float]
    """Limits that were applied, shares: of the trial, of a cycle, of the cycles with gaps."""


class Weight(Part, frozen=True):
    """One weight inside the object."""

    slot: int
    """Number of the place inside the object."""
    mass_g: float | None
    """None where not known."""


class OwnCard(Part, frozen=True, kw_only=True):
    """What the object knows of itself."""

    shape: str
    """``cube``, ``cylinder``, ``sphere``, ``other`` or ``unknown``."""
    size_mm: Known
    """Cube: edges x, y, z; cylinder: diameter and length; sphere: diameter; None for the rest."""
    surface: str
    """What it is made of or covered with, in the object's words."""
    mass_g: float | None
    """All of it, with its weights; None where not known."""
    com_mm: Known
    """Centre of mass in the object frame."""
    weights: tuple[Weight, ...]
    """Weights in their slots."""
    mounting_q_body_sensor: Known
    """Rotation from the sensor frame to the object frame, w, x, y, z."""


class RecordedObject(Part, frozen=True, kw_only=True):
    """The object as it introduced itself."""

    device_id: str
    """16 hex digits."""
    boot_id: int
    """Chosen at random at each start of the object."""
    firmware_version: tuple[int, int, int]
    """Major, minor, patch."""
    rate_hz: int
    """Orientation rate that it reported."""
    name: str
    """Its name."""
    sensor: str
    """Which IMU."""
    filter: str
    """Which orientation filter."""
    card: OwnCard
    """What it knows of itself."""
    protocol_major: int
    """Version of the wire protocol."""
    protocol_minor: int
    """Minor version of it."""


class LinkAccount(Part, frozen=True, kw_only=True):
    """The link, and all that its decoder counted (``firmware_protocol.items``, ``firmware_protocol.can.counters``).

    Older results lack what stands below ``reconnects``, and those of a serial link what only CAN has.
    """

    uri: str | None
    """The link, as it was named; None where not known."""
    crc_errors: int
    """Pieces with a wrong checksum, or too short to have one."""
    malformed: int
    """Frames whose packet cannot be that of its type."""
    unknown_types: int
    """Frames of a packet type of a newer minor version."""
    skipped_bytes: int
    """Bytes that are neither frame nor delimiter: damaged pieces, text, noise."""
    resets: int
    """Resets of the object."""
    reconnects: int
    """How often the link was opened again."""

    bytes: int | None = None
    """Bytes received."""
    pending_bytes: int | None = None
    """Of these, the start of a piece that did not end."""
    delimiters: int | None = None
    """Zero bytes."""
    frames: int | None = None
    """Frames with the right checksum; of a CAN link, those of the object."""
    frame_bytes: int | None = None
    """Bytes in these frames, without delimiters."""
    cobs_errors: int | None = None
    """Pieces that are not COBS."""
    oversize: int | None = None
    """Pieces longer than any frame."""
    partial_starts: int | None = None
    """Pieces in front of the first delimiter: the link was opened within a frame. No error."""
    packets: dict[str, int] | None = None
    """Packets delivered, by type."""
    unsupported_versions: int | None = None
    """INFO packets of another major version."""
    extended: int | None = None
    """Of the packets delivered, those with fields of a newer minor version at their end."""

    error_frames: int | None = None
    """CAN: reported by the interface."""
    remote_frames: int | None = None
    """CAN: nobody of ours sends or answers them."""
    foreign_frames: int | None = None
    """CAN: frames with ids of other devices."""
    other_node_frames: int | None = None
    """CAN: frames of objects with another node id, and commands to all."""
    host_frames: int | None = None
    """CAN: commands to this object, from this host or another."""
    wrong_lengths: int | None = None
    """CAN: frames whose length is not that of their function."""
    damaged_batches: int | None = None
    """CAN: batches of frames in a recording that are not valid."""
    unnumbered: int | None = None
    """Samples dropped because no TIME frame named their number."""
    misnumbered: int | None = None
    """Samples with a number 256 or more too low, as a later TIME frame showed."""
    refused: int | None = None
    """Samples dropped because two objects share the node id."""
    long_packet_errors: int | None = None
    """CAN: packets over several frames that failed."""


class ObjectEvent(Part, frozen=True):
    """A button or marker of the object."""

    time_s: float | None
    """On the recording's time axis; None where its place is not known."""
    kind: str
    """``BUTTON`` or ``MARKER``."""
    value: int
    """As the object sent it."""


class OperatorEvent(Part, frozen=True):
    """One thing the operator did during the capture."""

    kind: str
    """``window-start``, ``window-stop``, ``marker``, ``exclude``, ``include``, ``note``, ``pause`` or ``finish``."""
    time_s: float | None
    """Newest sample at that moment, since the first; None before it."""
    text: str
    """What the operator typed; may be empty."""
    from_s: float | None
    """End point at the start of the cycle that is meant; None where no cycle is."""
    to_s: float | None
    """End point at its end."""


class ClockSegment(Part, frozen=True):
    """Samples between two resets."""

    samples: int
    """How many."""
    skew_ppm: float | None
    """How much faster the object's clock runs than the host's; None where too short to tell."""


class ClockStep(Part, frozen=True):
    """A jump of the object's clock."""

    by_s: float
    """How far it jumped."""
    gap_s: float
    """Silence in which it happened."""


class OfflineClock(Part, frozen=True, kw_only=True):
    """The object's clock and the link's jitter, from the whole recording; of the longest segment where one is meant."""

    offset_ms: float
    """Host minus device clock."""
    offset_interval_ms: tuple[float, float] | None
    """The offset lies between these; None without round trips."""
    mapped_time_error_ms: tuple[float, float] | None
    """Bounds on the error of a sample's host time; None without round trips."""
    round_trips: int
    """Answers to TIME_REQUEST that were used."""
    consistent: bool
    """Whether every arrival and every round trip fits the clock: nothing received before it was sent."""
    skew_ppm: float | None
    """How much faster the object's clock runs than the host's."""
    jitter_p50_ms: float | None
    """Median delay of a chunk behind the fastest ones."""
    jitter_p99_ms: float | None
    """99th percentile of it."""
    window_s: float | None
    """Length of the windows that the skew was followed in; None for a single fit."""
    bursty: bool
    """Whether chunks come in bursts, as over Bluetooth."""
    arrivals: int
    """Chunks whose time was used."""
    samples_unplaced: int
    """Samples without a host time."""
    segments: tuple[ClockSegment, ...]
    """One for each reset or step of the clock."""
    steps: tuple[ClockStep, ...]
    """Jumps of the clock without a reset."""


class LiveClock(Part, frozen=True, kw_only=True):
    """The live estimate of the object's clock at the end of the capture."""

    segments: int
    """How many: one, and one more for each reset or step of the clock."""
    skew_ppm: float | None
    """How much faster the object's clock runs than the host's."""
    skew_uncertainty_ppm: float | None
    """Standard error of it."""
    offset_interval_ms: tuple[float, float] | None
    """The offset, host minus device, lies between these; None without round trips."""
    offset_uncertainty_ms: float | None
    """Half the width of that interval."""
    consistent: bool
    """Whether every arrival and every round trip fits the clock."""
    round_trips: int
    """Answers to TIME_REQUEST so far."""
    jitter_p50_ms: float | None
    """Median delay of a chunk behind the fastest ones."""
    jitter_p99_ms: float | None
    """99th percentile of it."""
    warm_up_s: float | None
    """Time until the estimate was usable; None where it never was."""
    bursty: bool
    """Whether chunks come in bursts."""


class CaptureAccount(Part, frozen=True, kw_only=True):
    """How the capture went."""

    recording: str
    """Path of the recording."""
    ended: str
    """Why."""
    error: str | None
    """What ended it, where it was an error."""
    warnings: tuple[str, ...]
    """What was reported meanwhile."""
    elapsed_s: float
    """From the first sample to the end."""
    clock: LiveClock | None
    """The live estimate at its end."""
    live_theta_bar_deg: float | None
    """θ̄ as the live view had it last."""
