"""The Agilent 33220A: its driver, and a simulator beside it."""
