"""How many more cycles an interval wants, by the interval's own formula."""

from __future__ import annotations

import math

from analysis.uncertainty import MIN_STEPS, DriftInterval

MAX_STEPS = 10_000
"""More steps than this are out of reach of a trial."""


def steps_needed(interval: DriftInterval, half_width_deg: float) -> int | None:
    """Smallest number of steps at which the interval would be narrow enough, if the steps go on to scatter as they do.

    The half-width is t(0.975, m − 1) times a standard error that falls with 1/√m; with SE the error at the present m₀,

        half-width(m) = t(0.975, m − 1) · SE · √(m₀ / m).

    Parameters
    ----------
    interval
        The present one.
    half_width_deg
        Wanted half-width, deg, above 0.

    Returns
    -------
    Number of steps m, at least ``MIN_STEPS``; None where ``MAX_STEPS`` are not enough.
    """
    from scipy import special  # late, as in analysis.uncertainty

    scale = interval.standard_error_deg * math.sqrt(interval.n_steps)
    level = 0.5 + 0.5 * interval.level

    def half_width(steps: int) -> float:
        return float(special.stdtrit(steps - 1, level)) * scale / math.sqrt(steps)

    if half_width(MAX_STEPS) > half_width_deg:
        return None
    low, high = MIN_STEPS - 1, MAX_STEPS  # half_width falls with the steps: the answer is in (low, high]
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if half_width(middle) <= half_width_deg else (middle, high)
    return high
