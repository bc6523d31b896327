"""The state of a trial at one moment: put together here and nowhere else, live and in a replay."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from analysis.scoring.result import Result
from analysis.scoring.summary import slip_of
from host.capture.alarms import AlarmWatch
from host.capture.guide import Guide
from host.capture.operator_desk import OperatorDesk
from host.trial.guarded import Guarded
from host.trial.live import Trial
from host.trial.running_score import RunningScore
from host.trial.state import LinkView, RecordingView, ScoreView, TargetView, TrialState


@dataclass
class Snapshots:
    """Puts states together, and keeps what depends on the states before: the alarms and the step of the guide."""

    trial: Trial
    desk: OperatorDesk
    title: str = "rotdrift"
    """Of the screen."""
    target: TargetView = TargetView()
    """When the capture will end."""
    guide: Guarded[Guide] | None = None
    _alarms: Guarded[AlarmWatch] = field(init=False)

    def __post_init__(self) -> None:
        self._alarms = Guarded("the alarms", AlarmWatch(), self.trial.failures, "none is raised any more")

    def at(
        self,
        now_ns: int,
        elapsed_s: float,
        link: LinkView,
        recording: RecordingView,
        warnings: tuple[str, ...] = (),
        enough: bool = False,
    ) -> TrialState:
        """Return the state at this moment; moments must come in order.

        ``now_ns`` is monotonic (of a replay: the recording's), ``elapsed_s`` counts from the first sample. Once there
        is ``enough`` (cycles, or as narrow an interval, as asked for), the guide goes on.
        """
        trial = self.trial
        state = TrialState(
            title=self.title,
            elapsed_s=elapsed_s,
            target=self.target,
            score=trial.score.ask(_score_view, ScoreView()),
            motion=trial.motion_view(),
            sensor=trial.sensor_view(),
            stream=trial.stream_view(now_ns),
            clock=trial.clock_view(),
            link=link,
            recording=recording,
            warnings=warnings,
            marks=self.desk.marks,
        )
        guide = None if self.guide is None else self.guide.ask(lambda guide: guide.update(state, enough), None)
        return replace(state, alarms=self._alarms.ask(lambda alarms: alarms.update(state), ()), guide=guide)


def finished_state(live: TrialState, score: Result) -> TrialState:
    """Return the last state with the result in place of the provisional figures, and what the difference is."""
    slip = slip_of(score)
    result = replace(
        live.score,
        slip="" if slip is None else slip.sentence,
        finished=True,
        theta_bar_deg=score.theta_bar_deg,
        interval_deg=score.interval_deg,
        half_width_deg=None if score.interval is None else score.interval.half_width_deg,
        summary=difference_sentence(live.score.theta_bar_deg, score),
    )
    return replace(live, score=result)


def difference_sentence(live_deg: float | None, score: Result) -> str:
    """Return in one sentence how the result differs from what the live view had."""
    if score.theta_bar_deg is None:
        return f"no score: {score.reasons[0]}" if score.reasons else "no score"
    if live_deg is None:
        return f"the live view had no score yet; the result has {len(score.endpoints) - 1} cycles"
    return f"live {live_deg:.3f}°, the result differs by {round(score.theta_bar_deg - live_deg, 3) + 0.0:+.3f}°"


def difference_fact(live_deg: float | None, score: Result) -> tuple[tuple[str, str], ...]:
    """Return the same for the printed score, a name and a text; nothing where the score itself has the reason."""
    if score.theta_bar_deg is not None:
        return (("live", difference_sentence(live_deg, score).removeprefix("live ")),)
    return () if live_deg is None else (("live", f"{live_deg:.3f}°, which the result does not confirm"),)


def _score_view(score: RunningScore) -> ScoreView:
    interval = score.interval
    return ScoreView(
        n_endpoints=score.n_endpoints,
        cycles=score.rows,
        theta_bar_deg=score.theta_bar_deg,
        interval_deg=None if interval is None else (interval.low_deg, interval.high_deg),
        half_width_deg=None if interval is None else interval.half_width_deg,
        more_cycles=score.more_cycles,
        slip=score.slip,
        origin_wxyz=score.origin_wxyz,
        window=score.window,
    )
