"""Checking a recording, ours or any MCAP file: what does not fit the format, or itself, each with its place."""
