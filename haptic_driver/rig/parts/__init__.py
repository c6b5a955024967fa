"""Each module has the parts of one type that come with the driver, such as generators or force
sensors.

A part is a section of the rig's file and the device made from it, side by side. A package adds a
kind by an entry point, see `haptic_driver.rig.part`.
"""
