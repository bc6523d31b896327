"""Blocks of samples as one series."""

from host.stream.series import SampleGatherer


def series_of(blocks, source="test"):
    gatherer = SampleGatherer()
    gatherer.add(blocks)
    return gatherer.series(source)
