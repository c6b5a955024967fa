"""Whether the diagnosis states right probabilities, by sets drawn from its own hypotheses."""
