"""The account of every sample, and what missing ones mean for a score."""
