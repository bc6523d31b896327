"""From end points to the result: θ̄ by the card, how far to trust it, and the tree that holds it all."""
