"""A trial as it happens: samples in, cycles and a running score out."""
