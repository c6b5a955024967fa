"""Made-up ticks for the ring buffer."""

from __future__ import annotations

from haptic_driver.processes.samples import SAMPLE


def made_tick(number, **fields):
    """A sample that is zero but for its number, its time of so many milliseconds, and these
    fields.
    """
    values = dict.fromkeys(SAMPLE.names, 0) | {"tick": number, "time_s": number * 1e-3} | fields
    assert len(values) == len(SAMPLE.names)
    return tuple(values.values())
