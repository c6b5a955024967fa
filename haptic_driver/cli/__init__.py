"""The `haptic` command line, one module per command group."""
