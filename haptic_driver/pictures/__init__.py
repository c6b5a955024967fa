"""Every picture that a command or the page shows."""
