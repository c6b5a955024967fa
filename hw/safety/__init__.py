"""These devices switch the output off when the driver cannot.

The watchdog is a process of its own. The driver beats over a pipe; when beats stop, it switches the
generator off over its own connection (`watchdog.py`). The interlock is a box with a contact in the
amplifier's enable line, which opens by its own clock when heartbeats stop (`interlock.py`). The
watchdog covers a driver that crashes or hangs, the box also a computer that fails.
`guarded_stage.py` lifts or stops a load stage likewise.

One rule holds: silence means off.
"""

__all__ = ["guarded_stage", "interlock", "simulated_interlock", "watchdog"]
