"""The daemon that a rig runs all day: render, control and recorder processes, their shared memory,
and the API.
"""
