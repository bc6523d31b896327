"""What a recording of ours knows, as parts of a result: object, link, losses, events, operator."""

from __future__ import annotations

from dataclasses import fields
from itertools import pairwise

import msgspec
import numpy as np

from analysis.scoring.recorded_parts import (
    CycleLosses,
    LinkAccount,
    Losses,
    ObjectEvent,
    OperatorEvent,
    OwnCard,
    RecordedObject,
    Weight,
)
from analysis.scoring.result_parts import known
from analysis.series import FloatArray
from firmware_protocol.packets import Info
from host.losses.ledger import LossReport
from host.losses.runs import missing_between
from host.recording.load import RecordedTrial
from host.text import plain


def losses_of(report: LossReport) -> Losses:
    """Return the account of all samples."""
    return Losses(
        produced=report.produced,
        received=report.received,
        lost=report.lost,
        rejected=report.rejected,
        duplicates=report.duplicates,
        reordered=report.reordered,
        segments=report.segments,
        exact=report.exact,
        dropped_by_device=report.dropped,
        missing=report.missing,
        share=round(report.share, 9),
        damaged_in_file=report.damaged_in_file,
    )


def losses_per_cycle(trial: RecordedTrial, endpoint_times_s: FloatArray) -> tuple[CycleLosses, ...]:
    """Return the account of the samples between neighbouring end points; each cycle starts with its end point's sample.

    For n end points it has n − 1 parts; none where the samples have no numbers.
    """
    series = trial.series
    if len(endpoint_times_s) < 2 or series.index_kind != "sequence":
        return ()
    at = np.searchsorted(series.times_s, endpoint_times_s).clip(0, len(series) - 1)
    bounds = series.index[at].tolist()
    return tuple(
        CycleLosses(
            produced=after - before,
            missing=gone.missing,
            rejected=gone.rejected,
            dropped_by_device=gone.dropped,
            received=after - before - gone.missing,
            lost=gone.lost,
            damaged_in_file=gone.damaged_in_file,
        )
        for (before, after), gone in zip(pairwise(bounds), missing_between(trial.missing, bounds), strict=True)
    )


def link_of(trial: RecordedTrial) -> LinkAccount:
    """Return the link with every counter of its decoder; one that the result has no place for is an error."""
    found = trial.counters
    names = {item.name for item in fields(found)} - {"packets"}
    counters: dict[str, object] = {name: int(getattr(found, name)) for name in names}
    counters["packets"] = {kind.name.lower(): n for kind, n in found.packets.items()}
    about = {
        "uri": None if trial.header is None else trial.header.link,
        "resets": max(0, len(trial.segments) - 1),
        "reconnects": trial.reconnects,
    }
    return msgspec.convert(about | counters, LinkAccount)


def object_of(info: Info | None) -> RecordedObject | None:
    """Return the object as it introduced itself: hexadecimal id, names of enums, texts safe to print."""
    if info is None:
        return None
    card = info.card
    return RecordedObject(
        device_id=f"{info.device_id:016x}",
        boot_id=info.boot_id,
        firmware_version=info.firmware_version,
        rate_hz=info.rate_hz,
        name=plain(info.name),
        sensor=plain(info.sensor),
        filter=plain(info.filter),
        card=OwnCard(
            shape=card.shape.name.lower(),
            size_mm=tuple(map(known, card.size_mm)),
            surface=plain(card.surface),
            mass_g=known(card.mass_g),
            com_mm=tuple(map(known, card.com_mm)),
            weights=tuple(Weight(weight.slot, known(weight.mass_g)) for weight in card.weights),
            mounting_q_body_sensor=tuple(map(known, card.mounting_q_body_sensor)),
        ),
        protocol_major=info.protocol_major,
        protocol_minor=info.protocol_minor,
    )


def events_of(trial: RecordedTrial) -> tuple[ObjectEvent, ...]:
    """Return the events of the object."""
    return tuple(ObjectEvent(known(event.time_s), event.kind, event.value) for event in trial.events)


def operator_of(trial: RecordedTrial) -> tuple[OperatorEvent, ...]:
    """Return what the operator did."""
    return tuple(
        OperatorEvent(action.kind, known(action.time_s), action.text, known(action.from_s), known(action.to_s))
        for action in trial.actions
    )
