"""Rotations as arrays: arithmetic, averages, Euler angles."""
