"""Recordings: written raw first, read whole or cut, recovered, and put together into trials."""
