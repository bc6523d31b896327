"""What all commands share before they run: the parser's words, a person's defaults, what the shell completes."""
