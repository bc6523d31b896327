"""Alarms from simulated states: raised once, held, cleared at a milder limit; and the steps of a guided trial."""

from dataclasses import replace

from host.capture.alarms import HOLD_S, AlarmWatch
from host.capture.guide import Guide, GuideSettings
from host.losses.ledger import LossReport
from host.trial.state import CycleRow, LinkView, MotionView, ScoreView, SensorView, StreamView, TrialState

STEP_S = 0.5


def row(number, step_deg=0.8, flags=()):
    return CycleRow(number, 4.0 * number, 4.0, step_deg if number else None, None, 0.8, flags)


def state(n=6, swing=40.0, rate=20.0, flags=(), **changes):
    base = TrialState(
        score=ScoreView(n, tuple(row(k) for k in range(n)), 0.8 if n > 1 else None),
        motion=MotionView("running", True, 4.0, swing, 0.5, flags, rate),
    )
    return replace(base, **changes)


class Watched:
    """Alarms over time."""

    def __init__(self):
        self.watch = AlarmWatch()
        self.now_s = 0.0

    def see(self, moment, for_s=STEP_S):
        """Show one state for a while; give the kinds that are up at its end."""
        kinds = ()
        for _ in range(max(1, round(for_s / STEP_S))):
            self.now_s += STEP_S
            kinds = tuple(alarm.kind for alarm in self.watch.update(replace(moment, elapsed_s=self.now_s)))
        return kinds


def test_an_ordinary_trial_raises_none():
    watched = Watched()
    for n in range(30):
        assert watched.see(state(n), 4.0) == ()


def test_movement_without_cycles_is_told_and_a_cycle_clears_it():
    watched = Watched()
    assert watched.see(state(0), 14.0) == ()
    assert watched.see(state(0), 2.0) == ("no cycles",)
    assert watched.see(state(1)) == ()
    resting = state(1, rate=0.1)
    assert watched.see(resting, 60.0) == ()


def test_an_ambiguous_axis_must_last():
    watched = Watched()
    assert watched.see(state(flags=("axis ambiguous",)), 1.5) == ()
    assert watched.see(state(), 1.0) == ()
    assert watched.see(state(flags=("axis ambiguous",)), 3.0) == ("axis",)
    assert watched.see(state(), 1.0) == ("axis",)
    assert watched.see(state(), 3.0) == ()


def test_a_shrinking_swing_has_hysteresis():
    watched = Watched()
    assert watched.see(state(swing=40.0)) == ()
    assert watched.see(state(n=7, swing=33.0)) == ()
    assert watched.see(state(n=8, swing=31.0)) == ("swing",)
    assert watched.see(state(n=9, swing=33.0)) == ("swing",)
    assert watched.see(state(n=10, swing=36.0)) == ()


def test_a_sudden_step_and_a_fall_are_told_for_a_while():
    watched = Watched()
    assert watched.see(state(6)) == ()
    slipped = state(7, rate=1.0)
    slipped = slipped.with_cycles((*slipped.score.cycles[:-1], row(6, 8.0)))
    assert watched.see(slipped) == ("reorientation",)
    assert watched.see(slipped, HOLD_S - 2) == ("reorientation",)
    assert watched.see(slipped, 3.0) == ()
    fallen = state(7)
    fallen = replace(fallen, motion=replace(fallen.motion, peak_rate_dps=900.0))
    assert watched.see(fallen) == ("reorientation",)


def test_a_pose_jump_is_sudden_too():
    watched = Watched()
    watched.see(state(3))
    jumped = state(4)
    jumped = jumped.with_cycles((*jumped.score.cycles[:-1], row(3, 2.0, ("pose jump",))))
    assert watched.see(jumped) == ("reorientation",)


def test_losses_count_over_the_last_seconds():
    watched = Watched()
    clean = StreamView(losses=LossReport(produced=1000, received=1000))
    assert watched.see(state(stream=clean)) == ()
    bad = StreamView(losses=LossReport(produced=1100, received=1080, lost=20))
    assert watched.see(state(stream=bad)) == ("losses",)
    later = StreamView(losses=LossReport(produced=9000, received=8980, lost=20))
    watched.see(state(stream=later), 11.0)
    assert watched.see(state(stream=later)) == ()


def test_silence_clock_saturation_and_floor():
    watched = Watched()
    assert watched.see(state(stream=StreamView(silent_s=3.0))) == ("link",)
    assert watched.see(state(stream=StreamView(silent_s=1.0))) == ("link",)
    assert watched.see(state(stream=StreamView(silent_s=0.1))) == ()
    stepped = StreamView(segments=2, segment_reason="the device clock stepped")
    assert watched.see(state(stream=stepped, rate=1.0)) == ("clock",)
    assert watched.see(state(stream=stepped, rate=1.0), HOLD_S + 1) == ()
    assert watched.see(state(sensor=SensorView(saturated=True))) == ("saturation",)
    assert watched.see(state(rate=1.0), HOLD_S + 1) == ()
    assert watched.see(state(sensor=SensorView(floor_deg=1.0))) == ("floor",)
    assert watched.see(state(sensor=SensorView(floor_deg=0.75))) == ("floor",)
    assert watched.see(state(sensor=SensorView(floor_deg=0.6))) == ()


def test_every_alarm_says_what_is_wrong_in_a_sentence():
    watch = AlarmWatch()
    alarms = watch.update(
        state(link=LinkView(connected=False), stream=StreamView(silent_s=9.0), sensor=SensorView(saturated=True))
    )
    assert [alarm.kind for alarm in alarms] == ["link", "saturation"]
    assert "9 s" in alarms[0].sentence


def test_the_guide_leads_through_rest_cycles_and_rest():
    guide = Guide(GuideSettings(rest_s=2.0, cycles=3))
    now_s = 0.0

    def go(moment, for_s, enough=False):
        nonlocal now_s
        for _ in range(round(for_s / STEP_S)):
            now_s += STEP_S
            view = guide.update(replace(moment, elapsed_s=now_s), enough)
        return view

    assert go(TrialState(), 5.0).title == "hold still"
    assert "waiting" in go(TrialState(), 1.0).hint
    assert go(state(0, rate=9.0), 5.0).hint == "it still moves"
    assert go(state(0, rate=0.1), 1.5).title == "hold still"
    view = go(state(0, rate=0.1), 1.0)
    while view.title == "hold still":
        assert view.hint == "1 s more at rest"
        view = go(state(0, rate=0.1), STEP_S)
    assert (view.title, view.hint, view.progress) == ("start the hand", "begin the rotation", 0.0)
    assert go(state(0, rate=0.1), 20.0).title == "start the hand"
    assert go(state(0), 1.0).title == "let it turn"
    view = go(state(3), 4.0)
    assert (view.title, view.hint) == ("let it turn", "2 of 3 cycles")
    assert go(state(4), 0.5, enough=True).title == "stop the hand, hold still"
    assert not guide.done
    assert go(state(4), 9.0, enough=True).title == "stop the hand, hold still"
    view = go(state(4, rate=0.1), 3.0, enough=True)
    assert (view.title, view.hint, view.progress) == ("done", "the trial is complete", 1.0)
    assert guide.done


def test_a_hand_that_did_not_wait_is_counted_all_the_same():
    guide = Guide(GuideSettings(rest_s=1.0, cycles=3))
    titles = [
        guide.update(replace(moment, elapsed_s=0.5 * k), state_enough).title
        for k, (moment, state_enough) in enumerate(
            [(state(0, rate=0.1), False), (state(0), False), (state(2), False), (state(3), False), (state(4), True)]
            + [(state(4, rate=0.1), True)] * 4
        )
    ]
    assert titles[:5] == ["hold still", "hold still", "let it turn", "let it turn", "stop the hand, hold still"]
    assert titles[-1] == "done"


def test_a_hand_that_stops_early_ends_the_cycles():
    guide = Guide(GuideSettings(rest_s=1.0))
    for k, moment in enumerate([state(0, rate=0.1)] * 4 + [state(0)] * 4 + [state(5)] * 4 + [state(5, rate=0.1)] * 20):
        guide.update(replace(moment, elapsed_s=0.5 * k), False)
    assert guide.done
