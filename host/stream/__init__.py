"""Chunks to timed, numbered, counted samples of one object."""
