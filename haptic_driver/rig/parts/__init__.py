"""The kinds of amplifiers, sensors, outputs and trackers that come with the driver: section and
device side by side.
"""
