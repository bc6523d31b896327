"""The parts of a result that come from a recording of ours: object, link, losses, clock, operator. The host fills them.

Names, order and units as in :mod:`analysis.scoring.result_parts`.
"""

from __future__ import annotations

from msgspec import structs

from analysis.scoring.result_parts import Known, Part


class Losses(Part, frozen=True, kw_only=True):
    """The account of all samples; ``produced == received + lost + rejected + dropped_by_device``."""

    produced: int
    received: int
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
    missing: int
    """Samples that were produced and are not here."""
    share: float
    """Missing samples as a share of those produced, 0-1."""


class CycleLosses(Part, frozen=True, kw_only=True):
    """The account of one cycle."""

    produced: int
    missing: int
    """Of these, samples that are not here."""
    rejected: int
    """Of the missing, those that arrived damaged."""
    dropped_by_device: int
    """Of the missing, those that the device dropped."""
    received: int
    lost: int
    """Of the missing, those lost on the link."""


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
    mass_g: float | None


class OwnCard(Part, frozen=True, kw_only=True):
    """What the object knows of itself."""

    shape: str
    size_mm: Known
    surface: str
    mass_g: float | None
    com_mm: Known
    """Centre of mass in the object frame."""
    weights: tuple[Weight, ...]
    mounting_q_body_sensor: Known


class RecordedObject(Part, frozen=True, kw_only=True):
    """The object as it introduced itself."""

    device_id: str
    """16 hex digits."""
    boot_id: int
    firmware_version: tuple[int, int, int]
    rate_hz: int
    name: str
    sensor: str
    filter: str
    card: OwnCard
    protocol_major: int
    protocol_minor: int


class LinkAccount(Part, frozen=True, kw_only=True):
    """The link, and all that its decoder counted (``firmware_protocol.items``, ``firmware_protocol.can.counters``).

    Older results lack what stands below ``reconnects``, and those of a serial link what only CAN has.
    """

    uri: str | None
    crc_errors: int
    malformed: int
    unknown_types: int
    skipped_bytes: int
    resets: int
    reconnects: int

    bytes: int | None = None
    pending_bytes: int | None = None
    delimiters: int | None = None
    frames: int | None = None
    frame_bytes: int | None = None
    cobs_errors: int | None = None
    oversize: int | None = None
    partial_starts: int | None = None
    packets: dict[str, int] | None = None
    """Packets delivered, by type."""
    unsupported_versions: int | None = None
    extended: int | None = None
    """Of the packets delivered, those with fields of a newer minor version at their end."""

    error_frames: int | None = None
    remote_frames: int | None = None
    foreign_frames: int | None = None
    other_node_frames: int | None = None
    host_frames: int | None = None
    wrong_lengths: int | None = None
    damaged_batches: int | None = None
    unnumbered: int | None = None
    """Samples dropped because no TIME frame named their number."""
    misnumbered: int | None = None
    """Samples with a number 256 or more too low, as a later TIME frame showed."""
    refused: int | None = None
    """Samples dropped because two objects share the node id."""
    long_packet_errors: int | None = None

    def without_counters(self) -> LinkAccount:
        """Return the account as older results have it."""
        required = [part.name for part in structs.fields(self) if part.required]
        return LinkAccount(**{name: getattr(self, name) for name in required})


class ObjectEvent(Part, frozen=True):
    """A button or marker of the object."""

    time_s: float | None
    kind: str
    """``BUTTON`` or ``MARKER``."""
    value: int


class OperatorEvent(Part, frozen=True):
    """One thing the operator did during the capture."""

    kind: str
    time_s: float | None
    """Newest sample at that moment, since the first; None before it."""
    text: str
    from_s: float | None
    """End point at the start of the cycle that is meant; None where no cycle is."""
    to_s: float | None
    """End point at its end."""


class ClockSegment(Part, frozen=True):
    """Samples between two resets."""

    samples: int
    skew_ppm: float | None


class ClockStep(Part, frozen=True):
    """A jump of the object's clock."""

    by_s: float
    gap_s: float
    """Silence in which it happened."""


class OfflineClock(Part, frozen=True, kw_only=True):
    """The object's clock and the link's jitter, from the whole recording; of the longest segment where one is meant."""

    offset_ms: float
    """Host minus device clock."""
    offset_interval_ms: tuple[float, float] | None
    """The offset lies between these; None without round trips."""
    mapped_time_error_ms: tuple[float, float] | None
    round_trips: int
    consistent: bool
    skew_ppm: float | None
    jitter_p50_ms: float | None
    jitter_p99_ms: float | None
    window_s: float | None
    bursty: bool
    arrivals: int
    """Chunks whose time was used."""
    samples_unplaced: int
    segments: tuple[ClockSegment, ...]
    steps: tuple[ClockStep, ...]


class LiveClock(Part, frozen=True, kw_only=True):
    """The live estimate of the object's clock at the end of the capture."""

    segments: int
    skew_ppm: float | None
    skew_uncertainty_ppm: float | None
    offset_interval_ms: tuple[float, float] | None
    offset_uncertainty_ms: float | None
    consistent: bool
    round_trips: int
    jitter_p50_ms: float | None
    jitter_p99_ms: float | None
    warm_up_s: float | None
    bursty: bool


class CaptureAccount(Part, frozen=True, kw_only=True):
    """How the capture went."""

    recording: str
    ended: str
    """Why."""
    error: str | None
    warnings: tuple[str, ...]
    elapsed_s: float
    clock: LiveClock | None
    live_theta_bar_deg: float | None
    """θ̄ as the live view had it last."""
