"""Whether a data file can test anything: rows, noise, and the effects that could show."""

from __future__ import annotations

from typing import NamedTuple

from model.description import ModelDescription
from model.diagnosis.data import Measurements
from model.diagnosis.hypotheses import testable_effects
from model.diagnosis.noise import Noise, noise_of
from model.effects import CATALOGUE, Effect

FEWEST_ROWS = 12
FEWEST_DRIVEN = 8


class Audit(NamedTuple):
    """A data set with its noise, and the effects to look for.

    `blocked` says why nothing can be tested; empty where something can.
    """

    data: Measurements
    noise: Noise | None
    kinds: list[type[Effect]]
    warnings: tuple[str, ...]
    blocked: str

    @property
    def untestable(self) -> tuple[str, ...]:
        """Effects of the catalogue that these data could not show, or that the model has."""
        return tuple(kind.name for kind in CATALOGUE if kind not in self.kinds)


def audited(description: ModelDescription, data: Measurements) -> Audit:
    """Look at the data before anything is fitted."""
    noise = noise_of(data)
    kinds = testable_effects(data, description.effects)
    left_out = f"{data.left_out} rows contradict Kramers and Kronig, and are left out"
    warnings: tuple[str, ...] = (left_out,) if data.left_out else ()
    warnings += data.notes
    if data.bad_rows:
        count = len(data.bad_rows)
        rows = "row that cannot be used is" if count == 1 else "rows that cannot be used are"
        warnings += (f"{count} {rows} left out: {'; '.join(data.bad_rows)}",)
    return Audit(data, noise, kinds, warnings, _blocked(data, noise, kinds))


def _blocked(data: Measurements, noise: Noise | None, kinds: list[type[Effect]]) -> str:
    if noise is None:
        return "no cof_std and no replicates: without a noise, a discrepancy may be chance"
    driven = int(data.driven.sum())
    if data.count < FEWEST_ROWS or driven < FEWEST_DRIVEN:
        needed = f"{FEWEST_ROWS} and {FEWEST_DRIVEN} are needed"
        return f"{data.rows} rows, {driven} with voltage: {needed}"
    if not kinds:
        return "every effect that these data could show is in the model already"
    return ""
