"""What the sensor adds by itself: the static baseline, its file, and rests inside a trial."""
