"""How many strokes of the hand make a cycle."""
