"""Where the finger is, and what it feels."""
