"""The touch as a camera sees it through the screen: film -> frames -> outline and ridges -> areas.

Read in this order: `film`, `light`, `touch`, `judge`.
"""

__all__ = ["film", "judge", "scale"]
