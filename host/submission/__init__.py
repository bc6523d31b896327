"""Submissions: made from trials, verified from their raw bytes, compared."""
