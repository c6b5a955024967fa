"""A rig is one set of devices around one finger: generator, amplifier, sensors, stages, interlock.

In goes the rig's file, which names a kind and the settings of each part (`config.py`, `parts`). Out
comes a `Rig`, which turns carrier frequency and voltage into device commands and readings into
signals.

`devices.py` opens the parts in an order that keeps the output off. `switch.py` and `states.py`
decide when the output may come on. `monitor.py` compares the amplifier with the command, and
`evidence.py` collects what shows that the output is off.

Two rules hold. The rig reports "off" only with evidence from an instrument. A figure that decides
about safety needs the name of who measured it, or the rig stays off.
"""

__all__ = [
    "actuator",
    "check",
    "config",
    "devices",
    "doctor",
    "envelope_writer",
    "evidence",
    "line_in",
    "load_controller",
    "load_gains",
    "load_loop",
    "part",
    "parts",
    "placement",
    "rig",
    "roles",
    "sealed",
    "slide",
    "states",
    "tick_settings",
]
