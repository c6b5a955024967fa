"""Data that nobody here made, and what the diagnosis makes of them; whoever has them runs it."""
