"""Any mix of faults, on a serial line and on CAN: the account is what became of the samples."""

import random
from dataclasses import replace

import numpy as np
import pytest

from emulator.faults.definitions import FaultSettings, TimedFault
from host.recording.load import assemble
from host.results.parts import losses_per_cycle
from tests.ledger_sessions import DAMAGE, RATES
from tests.recorded_trials import scenario
from tests.wire_oracle import watched_trial


def random_faults(rng, kind):
    names = RATES | (DAMAGE if kind == "serial" else {})
    rates = {name: rng.random() * limit for name, limit in names.items() if rng.random() < 0.5}
    if rng.random() < 0.3:
        rates |= {"delivery_interval_ms": rng.choice([1.0, 16.0, 30.0]), "delivery_jitter_ms": 10 * rng.random()}
    at = [
        TimedFault(name, at_s=rng.uniform(1.0, 6.0), for_s=rng.uniform(0.1, 2.0), by_s=rng.uniform(-3.0, 3.0))
        for name in ("stall", "unplug", "clock-step", "flood", "garbage")
        if rng.random() < 0.4
    ]
    return FaultSettings(**rates, at=tuple(at))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("kind", ["serial", "can", "can-fd"])
def test_the_account_is_what_became_of_the_samples(kind, seed):
    faults = random_faults(random.Random(f"{kind} {seed}"), kind)
    chunks, truth = watched_trial(replace(scenario("ideal", motion={"cycles": 2}), faults=faults), kind, seed)
    trial = assemble(chunks, kind)
    found = trial.losses
    for name in ("produced", "received", "dropped", "duplicates", "reordered"):
        if name != "dropped" or truth["closed"]:  # what no STATUS has told of yet is not known
            assert getattr(found, name) == truth[name], (name, faults)
    assert found.produced == found.received + found.lost + found.rejected + found.dropped
    # A damaged frame beside a lost one can be noise: nobody can tell.
    both = kind == "serial" and faults.drop_probability > 0
    if truth["closed"]:
        assert abs(found.rejected - truth["rejected"]) <= (0.1 * truth["rejected"] + 3 if both else 0), faults
    # Every sample stands once, in the order in which the object took it; and each belongs to one cycle.
    assert len(trial.series) == found.received
    assert (np.diff(trial.series.index) > 0).all()
    times_s = trial.series.times_s
    cycles = losses_per_cycle(trial, np.linspace(times_s[0], times_s[-1], 9).tolist())
    assert sum(cycle.missing for cycle in cycles) == sum(
        run.missing for run in trial.missing if trial.series.index[0] < run.end <= trial.series.index[-1]
    )
    for name in ("produced", "missing", "rejected", "dropped_by_device"):
        assert all(getattr(cycle, name) >= 0 for cycle in cycles)
