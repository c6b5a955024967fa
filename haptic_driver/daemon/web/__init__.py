"""The daemon's API and its page."""
