"""Devices of the rig: no physics, no driver."""
