"""A guided trial: hold still, start the hand, N cycles, hold still, done. Causal; time and states come from outside."""

from __future__ import annotations

import math
from dataclasses import dataclass

from host.trial.state import MOVING_DPS, REST_DPS, GuideView, TrialState

REST_PERIODS = 1.5
"""A hand that rests so long between cycles has been stopped early."""
TITLES = ("hold still", "start the hand", "let it turn", "stop the hand, hold still", "done")


@dataclass(frozen=True, slots=True)
class GuideSettings:
    """How long each step lasts."""

    rest_s: float = 10.0
    """At rest before and after: the shorter, the less is known of the sensor's own drift."""
    cycles: int = 10
    """Cycles to count, where the capture itself has no number and no interval to reach."""


class Guide:
    """Leads through a trial."""

    def __init__(self, settings: GuideSettings) -> None:
        self._settings = settings
        self._step = 0
        self._still_since_s: float | None = None

    @property
    def done(self) -> bool:
        """Whether the trial is complete."""
        return self._step == len(TITLES) - 1

    @property
    def title(self) -> str:
        """What is to be done now."""
        return TITLES[self._step]

    def update(self, state: TrialState, enough: bool) -> GuideView:
        """Go on with the next state, whose ``elapsed_s`` is the clock; return where the trial is.

        ``enough``: there are as many cycles, or as narrow an interval, as asked for.
        """
        rested_s = self._rested_s(state)
        self._advance(rested_s, state, enough)
        hint, progress = self._hint(state, rested_s)
        return GuideView(self._step + 1, len(TITLES), self.title, hint, progress)

    def _hint(self, state: TrialState, rested_s: float) -> tuple[str, float]:
        """Return how far this step is, in words and from 0 to 1."""
        if self.title == "start the hand":
            return "begin the rotation", 0.0
        if self.title == "let it turn":
            n, wanted = state.score.n_cycles, state.target.cycles or self._settings.cycles
            if state.target.half_width_deg is None:
                return f"{n} of {wanted} cycles", n / wanted
            more = wanted if state.score.more_cycles is None else state.score.more_cycles
            return f"{n} cycles", n / max(1, n + more)
        if self.done:
            return "the trial is complete", 1.0
        if state.motion.turn_rate_dps is None:
            return "waiting for the object", 0.0
        if self._still_since_s is None:
            return "it still moves", 0.0
        left_s = math.ceil(self._settings.rest_s - rested_s)
        return f"{left_s} s more at rest", rested_s / self._settings.rest_s

    def _rested_s(self, state: TrialState) -> float:
        """Return how long the object has been at rest; once it is, it may turn a little faster before it moves."""
        rate = state.motion.turn_rate_dps
        still = rate is not None and rate < (REST_DPS if self._still_since_s is None else MOVING_DPS)
        if not still:
            self._still_since_s = None
            return 0.0
        if self._still_since_s is None:
            self._still_since_s = state.elapsed_s
        return state.elapsed_s - self._still_since_s

    def _advance(self, rested_s: float, state: TrialState, enough: bool) -> None:
        n_cycles = state.score.n_cycles
        rested = rested_s >= self._settings.rest_s
        turns = (state.motion.turn_rate_dps or 0.0) > MOVING_DPS
        stopped = n_cycles > 0 and rested_s > REST_PERIODS * (state.motion.period_s or 10.0)
        if self._step == 0 and n_cycles > 0 and turns:  # a hand that did not wait: a trial without a rest before
            self._step = TITLES.index("let it turn")
        goes_on = (rested, turns, enough or stopped, rested, False)  # a condition for each of TITLES
        self._step += goes_on[self._step]
