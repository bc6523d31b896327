"""Settings of the whole suite: the same examples on every run, and no verdict that depends on the machine's speed."""

from hypothesis import settings

settings.register_profile("steady", derandomize=True, deadline=None)
settings.load_profile("steady")
