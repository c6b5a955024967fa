"""What was at the electrode, by the simulated amplifier's own record."""

from __future__ import annotations

import math


def history(record, after_s=-math.inf):
    """(time_s, voltage_v) of every change after a time; none while there is no record yet."""
    lines = record.read_text().splitlines() if record.exists() else []
    changes = [(float(time_s), float(voltage_v)) for time_s, _, voltage_v in map(str.split, lines)]
    return [(time_s, voltage_v) for time_s, voltage_v in changes if time_s > after_s]
