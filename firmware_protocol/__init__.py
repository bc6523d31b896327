"""What both ends of the wire agree on: packets, their bytes, and framing. No I/O, no clock."""
