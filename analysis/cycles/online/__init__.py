"""The same search while the hand turns: causal, constant work per sample, bounded memory."""
