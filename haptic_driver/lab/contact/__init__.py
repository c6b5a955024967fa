"""The touch as a camera sees it through the screen: film -> frames -> outline and ridges -> areas.

Read in this order: `film`, `light`, `touch`, `judge`. `panel_frame` tells the area from a panel's
capacitive frames, once a camera has calibrated them; `panel_file` has its files.
"""

__all__ = ["film", "judge", "panel_file", "panel_frame", "scale", "times"]
