"""Many records of a recording at once: what lets an hour be read in a second."""
