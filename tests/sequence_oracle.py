"""What the sequence numbers of samples show by themselves: the counters of the golden vectors.

A number ahead of the newest one by 2 to 32767 is a gap; a number at most ``LATE_WINDOW`` behind it was lost and comes
late, or comes once more; further behind, the object has started again. The host's ledger is no part of this: it also
goes by the device clock and STATUS.
"""

from collections import Counter

from firmware_protocol.packets import Info, OrientationBatch

LATE_WINDOW = 256


def sequences_of(items) -> list[int | None]:
    """Sequence numbers in decoded items; None where an INFO with another boot id shows a reset."""
    sequences: list[int | None] = []
    boot_id = None
    for item in items:
        if isinstance(item, OrientationBatch):
            sequences += item.sequence.tolist()
        elif isinstance(item, Info):
            sequences += [None] * (boot_id not in (None, item.boot_id))
            boot_id = item.boot_id
    return sequences


def followed(sequences: list[int | None]) -> Counter:
    """Sequence counters, with unbounded memory; None stands for a reset of the object."""
    counted = Counter()
    newest = None
    lost: set[int] = set()
    for sequence in sequences:
        if sequence is None or newest is None:
            newest = sequence
            lost.clear()
            continue
        # The unwrapped number nearest to the newest one.
        number = min((sequence + 65536 * (newest // 65536 + k) for k in (-1, 0, 1)), key=lambda n: (abs(n - newest), n))
        if number > newest:
            skipped = range(newest + 1, number)
            lost.update(skipped)
            counted["sequence_gaps"] += bool(skipped)
            counted["samples_lost"] += len(skipped)
            newest = number
        elif number < newest - LATE_WINDOW:
            counted["sequence_restarts"] += 1
            lost.clear()
            newest = number
        elif number in lost:
            lost.remove(number)
            counted["reordered"] += 1
            counted["samples_lost"] -= 1
        else:
            counted["duplicates"] += 1
    return +counted  # without zeros


def counted(items) -> Counter:
    """Sequence counters of decoded items."""
    return followed(sequences_of(items))
