"""Alarms: what should make the operator look up, with a sentence each.

Causal, and with hysteresis: an alarm is raised at one limit and cleared at a milder one, or after a while, so that it
does not flicker. Nothing in here changes the capture or the score.
"""

from __future__ import annotations

from collections import deque
from statistics import median

from analysis.scoring.interval import MIN_STEPS
from host.trial.state import MOVING_DPS, UNCOUNTED, Alarm, CycleRow, TrialState

NO_CYCLES_S, NO_CYCLES_PERIODS = 15.0, 3.0
"""No cycle found after so much movement, whichever is longer."""
AXIS_S = 2.0
"""How long the axis must be ambiguous (or clear again)."""
SWING_RAISE, SWING_CLEAR = 0.80, 0.88
"""Shares of the widest swing so far."""
SWING_ENDPOINTS = 4
"""End points before the swing is compared."""
STEP_FACTOR, STEP_DEG = 6.0, 5.0
"""A step is sudden above both: so many times the median step, and so many degrees."""
JUMP_FACTOR = 2.0
"""So many times the median step must be a jump of the pose that the detector flags."""
DROP_DPS = 500.0
"""A turning rate no hand reaches on purpose."""
LOSS_RAISE, LOSS_CLEAR = 0.01, 0.005
"""Shares of missing samples over :data:`LOSS_WINDOW_S`."""
LOSS_WINDOW_S = 10.0
HOLD_S = 15.0
"""How long an alarm of one moment stays up."""
SILENT_RAISE_S, SILENT_CLEAR_S = 2.0, 0.5
FLOOR_CLEAR = 1.15
"""θ̄ over the floor at which that alarm is cleared."""


class AlarmWatch:
    """Watches states in the order of time.

    Every alarm is one of two kinds: most follow the state, up from one limit to a milder one (``_follow``); what
    happens in a moment stays up for a while (``_hold``).
    """

    def __init__(self) -> None:
        self._up: dict[str, str] = {}
        self._until_s: dict[str, float] = {}
        self._before = TrialState()
        self._moved_s = 0.0  # since the last end point
        self._way_s = 0.0  # movement before the last end point, since the one before
        self._axis_since_s: float | None = None  # since when the axis alarm is due to change
        self._widest_deg = 0.0
        self._losses: deque[tuple[float, int, int]] = deque()  # (s, produced, missing) of the last seconds

    def update(self, state: TrialState) -> tuple[Alarm, ...]:
        """Watch the next state, whose ``elapsed_s`` is the clock; return the alarms that are up, most urgent first."""
        now_s, before = state.elapsed_s, self._before
        if state.score.n_endpoints < before.score.n_endpoints:  # end points were withdrawn: start again
            self._moved_s = self._way_s = self._widest_deg = 0.0
        for kind in [kind for kind, until_s in self._until_s.items() if now_s >= until_s]:
            del self._until_s[kind]
            self._up.pop(kind, None)
        self._watch_link(state, before)
        self._watch_losses(state)
        self._watch_moments(state, before)
        self._watch_cycles(state, before)
        self._watch_axis(state)
        self._watch_swing(state)
        self._watch_floor(state)
        self._before = state
        return tuple(Alarm(kind, self._up[kind]) for kind in ORDER if kind in self._up)

    def _follow(self, kind: str, raised: bool, cleared: bool, sentence: str) -> None:
        """Raise, clear, or leave an alarm as it is; its sentence follows the newest figures."""
        if raised or (kind in self._up and not cleared):
            self._up[kind] = sentence
        elif cleared:
            self._up.pop(kind, None)

    def _hold(self, kind: str, now_s: float, sentence: str) -> None:
        """Raise an alarm of one moment."""
        self._up[kind] = sentence
        self._until_s[kind] = now_s + HOLD_S

    def _watch_link(self, state: TrialState, before: TrialState) -> None:
        lost, silent_s = not state.link.connected, state.stream.silent_s
        silent = silent_s > SILENT_RAISE_S
        parts = ["the link is lost"] if lost else []
        if silent or not lost:
            parts.append(f"nothing has come for {silent_s:.0f} s")
        sentence = f"{', '.join(parts)}: check the object's battery and cable"
        self._follow("link", lost or silent, not lost and silent_s < SILENT_CLEAR_S, sentence)
        if state.stream.segments > max(1, before.stream.segments):
            why = state.stream.segment_reason or "the device clock jumped"
            self._hold("clock", state.elapsed_s, f"{why}; the host's clock places what follows")

    def _watch_losses(self, state: TrialState) -> None:
        now_s, losses = state.elapsed_s, state.stream.losses
        self._losses.append((now_s, losses.produced, losses.missing))
        while self._losses[0][0] < now_s - LOSS_WINDOW_S and len(self._losses) > 2:
            self._losses.popleft()
        _, produced_before, missing_before = self._losses[0]
        missing = losses.missing - missing_before
        share = missing / max(1, losses.produced - produced_before)
        sentence = f"{100 * share:.1f} % of the last samples are missing: check cable and distance"
        self._follow("losses", share > LOSS_RAISE and missing > 1, share < LOSS_CLEAR, sentence)

    def _watch_moments(self, state: TrialState, before: TrialState) -> None:
        now_s, rate, cycles = state.elapsed_s, state.motion.peak_rate_dps or 0.0, state.score.cycles
        if rate > DROP_DPS:
            self._hold("reorientation", now_s, f"it turned at {rate:.0f}°/s: was it dropped?")
        if cycles and cycles[-1].step_deg is not None and before.score.cycles[-1:] != cycles[-1:]:
            row, step_deg = cycles[-1], cycles[-1].step_deg
            usual_deg, usual_s = _usual(cycles[:-1])
            # A step over a gap spans several cycles, and is as many times as long.
            share_deg = step_deg / (max(1, round(row.period_s / usual_s)) if row.period_s and usual_s else 1)
            large = len(cycles) > 3 and share_deg > max(STEP_DEG, STEP_FACTOR * usual_deg)
            if large or ("pose jump" in row.flags and share_deg > JUMP_FACTOR * usual_deg):
                sentence = f"cycle {row.number} moved it {step_deg:.1f}°: dropped, regrasped? (x: exclude)"
                self._hold("reorientation", now_s, sentence)
        if state.sensor.saturated:
            self._hold("saturation", now_s, "beyond the sensor's range: turn slower, or do not trust θ̄")

    def _watch_cycles(self, state: TrialState, before: TrialState) -> None:
        if state.motion.phase == UNCOUNTED:  # nobody looks for cycles any more: that none is found means nothing
            self._moved_s = 0.0
        elif state.score.n_endpoints != before.score.n_endpoints:
            self._way_s, self._moved_s = self._moved_s, 0.0
        elif (state.motion.turn_rate_dps or 0.0) > MOVING_DPS:
            self._moved_s += max(0.0, min(1.0, state.elapsed_s - before.elapsed_s))
        # While no period is known, only the way to the first end point shows how slow the motion is.
        period_s = state.motion.period_s or self._way_s
        limit_s = max(NO_CYCLES_S, NO_CYCLES_PERIODS * period_s)
        sentence = f"{self._moved_s:.0f} s of movement without a cycle: is one rotation repeated?"
        self._follow("no cycles", self._moved_s > limit_s, self._moved_s < limit_s, sentence)

    def _watch_axis(self, state: TrialState) -> None:
        now_s = state.elapsed_s
        ambiguous = "axis ambiguous" in state.motion.flags and (state.motion.turn_rate_dps or 0.0) > MOVING_DPS
        if ambiguous == ("axis" in self._up):
            self._axis_since_s = None
        elif self._axis_since_s is None:
            self._axis_since_s = now_s
        lasted = self._axis_since_s is not None and now_s - self._axis_since_s >= AXIS_S
        sentence = "it turns about no single axis: cycles may end at the wrong moment"
        self._follow("axis", ambiguous and lasted, not ambiguous and lasted, sentence)

    def _watch_swing(self, state: TrialState) -> None:
        swing = state.motion.swing_deg
        if swing is None or state.score.n_endpoints < SWING_ENDPOINTS:
            return
        self._widest_deg = max(self._widest_deg, swing)
        share = swing / self._widest_deg if self._widest_deg else 1.0
        sentence = f"down from {self._widest_deg:.0f}° to {swing:.0f}°: is it slipping out of the hand?"
        self._follow("swing", share < SWING_RAISE, share > SWING_CLEAR, sentence)

    def _watch_floor(self, state: TrialState) -> None:
        theta, floor = state.score.theta_bar_deg, state.sensor.floor_deg
        if theta is None or floor is None or state.score.n_cycles < MIN_STEPS:
            self._up.pop("floor", None)
            return
        sentence = f"θ̄ is below the sensor's floor of {floor:.2g}°, no drift at all looks the same; more cycles help"
        self._follow("floor", theta < floor, theta > FLOOR_CLEAR * floor, sentence)


def _usual(rows: tuple[CycleRow, ...]) -> tuple[float, float]:
    """Medians of the steps, deg, and of the periods, s; 0 where there are none."""
    steps = [row.step_deg for row in rows if row.step_deg is not None]
    periods = [row.period_s for row in rows if row.period_s is not None]
    return (median(steps) if steps else 0.0), (median(periods) if periods else 0.0)


ORDER = ("link", "saturation", "reorientation", "losses", "clock", "no cycles", "axis", "swing", "floor")
"""Kinds of alarms, the most urgent first."""
