"""Real-time haptic rendering for electroadhesion touch screens."""
