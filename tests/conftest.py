"""Settings of the whole suite: the same examples on every run, and no verdict that depends on the machine's state."""

import os
import signal

import pytest
from hypothesis import HealthCheck, settings

# Hypothesis would judge by the clock whether examples are made fast enough: on a busy machine they are not.
settings.register_profile("steady", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("steady")


def pytest_xdist_auto_num_workers() -> int:
    """Three test processes for two processors: about half of a run is waiting for virtual objects in real time."""
    return max(1, len(os.sched_getaffinity(0)) * 3 // 2) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@pytest.fixture(scope="session", autouse=True)
def _signals_reach_the_programs_under_test():
    """Let programs that tests start have every signal, also where the suite runs in the background.

    A shell ignores SIGINT and SIGQUIT for what it starts with ``&``, and nohup ignores SIGHUP. Who starts a program
    passes on what it ignores, but not what it handles: a handler that does nothing protects the suite alone.
    """
    for name in ("SIGHUP", "SIGINT", "SIGQUIT", "SIGTERM", "SIGTSTP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, lambda *_: None)
