"""Where the finger is, and what it feels."""

__all__ = ["body", "plant", "simulated_touch_screen", "touch_screen", "tracker"]
