"""Object, hand and trial cards: what the benchmark asks for beside the score."""
