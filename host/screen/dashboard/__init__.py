"""The dashboard: what the terminal shows of a trial."""
