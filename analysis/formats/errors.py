"""What writing raises on purpose: :class:`WriterError`, an :class:`~analysis.series.AnalysisError`."""

from __future__ import annotations

from analysis.series import AnalysisError


class WriterError(AnalysisError):
    """A format that cannot hold this recording, or needs a package that is not installed."""
