"""What goes wrong on purpose, on packets, on bytes and at given moments."""
