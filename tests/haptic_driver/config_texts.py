"""Configuration files made of the shipped ones."""

from __future__ import annotations

from pathlib import Path

CONFIGS = Path(__file__).parents[2] / "configs"
SIMULATED = (CONFIGS / "rigs" / "simulated.toml").read_text(encoding="utf-8")
DEVICES = """
[interlock]
kind = "box"
resource = "{interlock}"
[watchdog]
generator = "{waveform_generator}"
interlock = "{interlock_tcp}"
[force_sensor]
kind = "net_ft"
host = "127.0.0.1"
port = {port}
counts_per_n = 1e6
counts_per_n_m = 1e6
normal_axis = "-z"
lateral_axis = "x"
"""


def changed(text, *changes):
    """The text with each (old, new) replaced once; all that is old must be there."""
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


def as_real_rig(resource):
    """The simulated rig's file with a generator at a resource; a real rig's other devices are still
    to be added.
    """
    monitors = SIMULATED[SIMULATED.index("[[electrode_monitors]]") : SIMULATED.index("[output]")]
    return changed(
        SIMULATED,
        (monitors, ""),
        ("simulated = true", "simulated = false"),
        ('resource = "simulated"', f'resource = "{resource}"'),
    )


def served_rig_text(endpoints):
    """The file of a real rig whose devices `haptic simulate` serves; stage and finger tracker are
    still to be added.
    """
    port = endpoints["force_sensor"].split(":")[1]
    return as_real_rig(endpoints["waveform_generator"]) + DEVICES.format(port=port, **endpoints)
