"""Any recording scored, alone or in a batch, and shown to people."""
