"""What reporting raises on purpose.

AnalysisError
    BundleError       a submission that cannot be read, or is refused: not a zip, hostile, damaged, not ours
    ComparisonError   results that cannot stand in one table: other conventions, other score versions
"""

from __future__ import annotations

from analysis.series import AnalysisError


class BundleError(AnalysisError):
    """A bundle that is refused or cannot be read; one sentence says why."""


class ComparisonError(AnalysisError):
    """Results that must not be compared without saying so; the message names what differs."""
