"""Papers that a laboratory hands in: what stands on them, and how they are laid out."""
