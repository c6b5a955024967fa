"""Every stroke of a measured experiment: its file (`file.py`), and means over strokes
(`means.py`).
"""

__all__ = ["file", "means"]
