"""Analog and digital lines of cards: monitors, envelopes, levels."""
