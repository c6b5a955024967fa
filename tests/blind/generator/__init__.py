"""Independent generator of friction measurements with hidden effects."""
