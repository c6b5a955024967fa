"""One byte-level contract for every way to reach an instrument."""
