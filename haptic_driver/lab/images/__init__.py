"""Pictures and films as people have them -> grey shares of full scale, finite and upright.

Read in this order: `pixels`, `tiff`, `files`.
"""

__all__ = ["files", "pixels"]
