"""Mending the finger's model while something renders: when it is tried, and by which rows."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from haptic_driver.daemon.observation import Proposal
from haptic_driver.experiments.mending import LEAST_HELD_OUT, MOST_ROWS, Dropped, Mended, mend
from haptic_driver.experiments.recorded import Recorded
from haptic_driver.limits import OperatingLimits
from haptic_driver.surface.build import build_surface
from model.description import ModelDescription

PERIOD_S = 5.0  # between attempts, of the rows' time
DIGITS = 5  # of a row's numbers, as they are told


class Adaptation:
    """The model as its file has it, and what has been made of it since somebody armed."""

    def __init__(
        self,
        description: ModelDescription,
        limits: OperatingLimits,
        mend: Callable[..., Mended | Dropped] = mend,
    ) -> None:
        self._description, self._limits, self._mend = description, limits, mend
        self.begin()

    def begin(self) -> None:
        """Another finger, or back to the model's file."""
        self._present = self._offered = self._description
        self._rows: deque[Recorded] = deque(maxlen=MOST_ROWS)
        self._tried_s = float("-inf")

    def taken(self) -> None:
        """Render goes by what was proposed last."""
        self._present = self._offered

    def add(self, rows: Sequence[Recorded]) -> Proposal | None:
        """What some more rows, later ones, lead to; None where there is nothing to try yet."""
        self._rows.extend(rows)
        if not rows or rows[-1].measured.time_s - self._tried_s < PERIOD_S:
            return None
        known, held_out = split(self._rows)
        if len(held_out) < LEAST_HELD_OUT or not known:
            return None
        self._tried_s = rows[-1].measured.time_s
        found = self._mend(known, self._description, held_out, self._present)
        if not isinstance(found, Mended):
            return Proposal(found.said)
        self._offered = found.model
        surface = build_surface(found.model, self._limits)
        return Proposal(
            found.said, surface, numbers(found.model), [told(row) for row in (*known, *held_out)]
        )


def split(rows: Sequence[Recorded]) -> tuple[list[Recorded], list[Recorded]]:
    """Rows in the order of time, without the newest strokes, and those: as few as give enough
    rows.
    """
    held_out = list(rows)
    for stroke in sorted({row.row.trial for row in rows}, reverse=True):
        newest = [row for row in rows if row.row.trial >= stroke]
        if len(newest) >= LEAST_HELD_OUT:
            held_out = newest
            break
    return [row for row in rows if row.row.trial < held_out[0].row.trial], held_out


def numbers(model: ModelDescription) -> dict[str, float]:
    """Every number of a model and of its effects."""
    own = {name: p.value for name, p in model.parameters.items()}
    effects = model.effect_parameters.items()
    return own | {
        f"{effect}.{name}": p.value for effect, values in effects for name, p in values.items()
    }


def told(each: Recorded) -> list[float]:
    """A row as frequency, voltage, load, speed, friction, its standard error and its time."""
    setting, measured = each.row.setting, each.measured
    conditions = setting.frequency_hz, setting.voltage_v, setting.normal_force_n, setting.speed_m_s
    values = *conditions, measured.cof, measured.cof_std
    return [*(float(f"{value:.{DIGITS}g}") for value in values), round(measured.time_s, 3)]
