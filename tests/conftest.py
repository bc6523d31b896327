"""Settings of the whole suite: the same examples on every run, and no verdict that depends on the machine's speed."""

import signal

from hypothesis import settings

settings.register_profile("steady", derandomize=True, deadline=None)
settings.load_profile("steady")

# A shell that runs the suite in the background has SIGINT ignored, and so have all processes that the tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
