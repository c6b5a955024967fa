"""Lines in whose boxes a test can reach, on a daemon of its own process; not a test."""

from __future__ import annotations

from haptic_driver.rig.part import Part
from haptic_driver.rig.parts.event_lines import SimulatedEventLineConfig
from haptic_driver.rig.parts.lines_in import SimulatedLineInConfig
from hw.event_line.simulated import SimulatedEventLine, SimulatedLineIn

LOW_S = 0.05
LINE, LINE_IN = SimulatedEventLine(), SimulatedLineIn(code=7)


class ReachedEventLine(SimulatedEventLineConfig):
    def make(self, wiring):
        return Part(LINE)


class ReachedLineIn(SimulatedLineInConfig):
    def make(self, wiring):
        return Part(LINE_IN)


def with_lines(config, folder):
    """A rig with both, whose edges record into a folder."""
    event_line = ReachedEventLine(kind="simulated", pulse_s=2e-3)
    line_in = ReachedLineIn(kind="simulated", low_s=LOW_S, folder=str(folder), code=7)
    return config.model_copy(update={"event_line": event_line, "line_in": line_in})
