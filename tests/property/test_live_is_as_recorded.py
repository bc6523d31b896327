"""Live and from the recording the same, to the sample, whatever happens on the wire.


``python -m benchmarks.live_and_recorded --sessions 1000`` runs as many as there is time for.
"""

import pytest

from tests.ledger_sessions import made_session, wrong_with


@pytest.mark.parametrize("slice_number", range(3))
def test_sessions_with_any_faults_and_values(slice_number):
    changed = 0
    for seed in range(5 * slice_number, 5 * slice_number + 5):
        session = made_session(seed)
        changed += len(session.mutations)
        assert wrong_with(session) == [], (seed, session.faults, session.mutations)
    assert changed > 0


@pytest.mark.parametrize("seed", [66, 114, 267, 432, 780, 1125, 1242, 1359, 7, 22])
def test_sessions_that_once_differed(seed):
    assert wrong_with(made_session(seed)) == []
