"""Object, hand and trial cards: what the benchmark card wants to know beside the score."""
