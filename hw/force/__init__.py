"""A force sensor gives the normal and the lateral force on the touch screen, in newtons.

Gauges come through an analog card with the maker's calibration (`ati_calibration.py`), or forces as
UDP records from a Net F/T box (`net_ft.py`). `sensor.py` is what both look like to the rig: a
reading with its time and a flag for saturation.

Two rules hold. A saturated reading is marked, and its numbers are not to be trusted. An unknown
force is NaN, never zero.
"""

__all__ = ["ati_calibration", "net_ft", "net_ft_server", "sensor"]
