"""The rows of a source: what a cell is, where the table starts, which stream and which session a row belongs to."""
