"""The device's clock on the host's time line: live, and again from a recording."""
