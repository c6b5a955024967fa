"""Pure render stages: (settings, state, input) -> (state, output)."""
