"""Where each cycle of a motion ends: the search, step by step."""
