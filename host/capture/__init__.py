"""A capture while it runs: its loop, one or several objects, keys, guide and alarms."""
