"""Force sensors."""
