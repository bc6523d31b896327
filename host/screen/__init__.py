"""What the operator sees and types: the terminal, its keys, and the process that draws."""
