"""What no effect of the catalogue explains: an empirical term at one place of the chain, under no
physical name.

The logarithm of one quantity of the chain is shifted by g(inputs). g is a sum of natural cubic
splines over one input or a pair of them, or of short formulas, one per input. A spline's parameters
are its values at the nodes, so a model file is readable. Between nodes the term is as smooth as
they are far apart. It is known where it was measured; outside that range it keeps the value of the
nearest end. Call `outside` to find rows beyond the range.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, make_dataclass, replace
from functools import cache
from itertools import product
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from model.effects.base import Effect, Stage, linear_parameter, log_parameter
from model.parameters import TouchParameters
from model.support.arrays import Array, Values
from model.touch import Branch, Contact, Drive, Friction

LEARNED = "learned"
LOG_INPUTS = ("frequency_hz", "normal_force_n", "speed_m_s")
UNITS = {
    "frequency_hz": "Hz",
    "voltage_v": "V",
    "normal_force_n": "N",
    "speed_m_s": "m/s",
    "time_s": "s",
}
INPUTS = tuple(UNITS)
NEEDED = ("speed_m_s", "time_s")  # optional columns
Shape = Literal["spline", "power", "saturation", "step"]
SHAPES: tuple[Shape, ...] = ("spline", "power", "saturation", "step")


class Quantity(NamedTuple):
    """What a term may multiply: its place in the chain, the inputs that can reach it there, whether
    it has a phase.
    """

    place: Stage
    words: str
    inputs: tuple[str, ...]
    has_phase: bool = False


ELECTRIC = ("frequency_hz", "voltage_v", "time_s")
QUANTITIES: dict[str, Quantity] = {
    "friction": Quantity("friction", "friction as the sensor reads it", INPUTS),
    "skin_stiffness": Quantity(
        "contact", "stiffness of the rough contact", ("normal_force_n", "speed_m_s", "time_s")
    ),
    "gap_field": Quantity("air gap", "field in the gap's air", INPUTS),
    "gap_permittivity": Quantity("air gap", "admittance of the gap's air", INPUTS, has_phase=True),
    "series_impedance": Quantity(
        "stack", "impedance of insulator and skin", ELECTRIC, has_phase=True
    ),
    "voltage": Quantity("drive", "voltage at the electrode", ELECTRIC, has_phase=True),
}


@dataclass(frozen=True)
class Term:
    """One summand: its inputs, one or two, and the nodes of each in SI units, whose ends are the
    range measured.

    `amplitude`: one prior standard deviation of what it adds to log(quantity).
    """

    inputs: tuple[str, ...]
    nodes: tuple[tuple[float, ...], ...]
    amplitude: float = 1.0


@dataclass(frozen=True)
class LearnedForm:
    """Which quantity is learned, as which shape of which inputs.

    `with_phase`: its phase is shifted likewise. `lowest_voltage_v` is the lowest measured. Below it
    what depends on frequency fades out as the force does, for without voltage there is no
    frequency.
    """

    acts_on: str
    shape: Shape
    terms: tuple[Term, ...]
    lowest_voltage_v: float
    with_phase: bool = False

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> LearnedForm:
        """The form again, from what `asdict` made of it, also after JSON."""
        terms = [
            Term(tuple(term["inputs"]), tuple(map(tuple, term["nodes"])), term["amplitude"])
            for term in given["terms"]
        ]
        return cls(**{**given, "terms": tuple(terms)})

    @property
    def place(self) -> Stage:
        return QUANTITIES[self.acts_on].place

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Of every input, low and high; voltages from 0, where voltage does nothing."""
        found = {
            name: (n[0], n[-1])
            for t in self.terms
            for name, n in zip(t.inputs, t.nodes, strict=True)
        }
        return {
            name: (0.0 if name == "voltage_v" else low, high) for name, (low, high) in found.items()
        }

    def outside(self, drive: Drive) -> str:
        """Which setting of a drive lies outside the range measured, in words; empty where none
        does.

        Speed and time do not count: fingers slide as they do, and the term is held at the nearest
        end.
        """
        for name, (low, high) in self.ranges.items():
            if name in NEEDED:
                continue
            asked = np.broadcast_to(
                getattr(drive, name), np.broadcast_shapes(*map(np.shape, vars(drive).values()))
            )
            asked = (
                asked[np.broadcast_to(drive.voltage_v, asked.shape) > 0.0]
                if name == "frequency_hz"
                else asked
            )
            slack = 1e-9 * max(abs(low), abs(high))
            if np.any((asked < low - slack) | (asked > high + slack)):
                return (
                    f"{name} {asked.min():g}..{asked.max():g} {UNITS[name]} (learned from {low:g}"
                    f" to {high:g})"
                )
        return ""

    def weights(self, drive: Drive) -> list[Array]:
        """What each value at a node counts in g under a drive, in the order of the parameters;
        shapes broadcast.
        """
        found = []
        for term in self.terms:
            first, *second = (
                spline_weights(scaled(name, drive, nodes), scaled_nodes(name, nodes))
                for name, nodes in zip(term.inputs, term.nodes, strict=True)
            )
            columns = [self.share(term, drive) * w for w in np.moveaxis(first, -1, 0)]
            for other in second:
                columns = [w * x for w in columns for x in np.moveaxis(other, -1, 0)]
            found += columns
        return found

    def share(self, term: Term, drive: Drive) -> Array:
        """How much of a term there is: of frequency, as much as there is of the force."""
        if "frequency_hz" not in term.inputs:
            return np.ones(1)
        square = np.square(np.asarray(drive.voltage_v) / self.lowest_voltage_v)
        return np.asarray(np.minimum(square, 1.0) * (1.0 - np.asarray(drive.steady)))

    def formula(self, term: Term, values: list[Values], drive: Drive) -> Values:
        """One input's power, saturation or step, as a logarithm."""
        name, (low, high) = term.inputs[0], term.nodes[0]
        x = (
            np.exp(scaled(name, drive, (low, high)))
            if name in LOG_INPUTS
            else scaled(name, drive, (low, high)) - low
        )
        usual = middle(name, (low, high))
        if self.shape == "power":
            return values[0] * np.log(np.maximum(x, 1e-3 * usual) / usual)
        steepness = values[2] if self.shape == "step" else 1.0
        return values[0] / (1.0 + (values[1] / np.maximum(x, 1e-6 * usual)) ** steepness)


def scaled(name: str, drive: Drive, nodes: tuple[float, ...]) -> Array:
    """An input held within its nodes, as a logarithm where it spans decades."""
    x = np.clip(np.asarray(getattr(drive, name), float), nodes[0], nodes[-1])
    return np.asarray(np.log(x) if name in LOG_INPUTS else x)


def scaled_nodes(name: str, nodes: tuple[float, ...]) -> Array:
    return np.log(nodes) if name in LOG_INPUTS else np.asarray(nodes)


def middle(name: str, nodes: tuple[float, ...]) -> float:
    """Of an input's range, as its formulas count it: from 0 up, where it is no logarithm from its
    low end.
    """
    return (
        float(np.sqrt(nodes[0] * nodes[-1])) if name in LOG_INPUTS else 0.5 * (nodes[-1] - nodes[0])
    )


def spline_weights(x: Array, nodes: Array) -> Array:
    """W [..., m] such that W @ y is the natural cubic spline through (nodes, y) [m >= 2] at `x`
    [...] between them.
    """
    h, m = np.diff(nodes), nodes.size
    bend, inner = (
        np.zeros((m, m)),
        np.arange(1, m - 1),
    )  # from values to second derivatives, none at both ends
    if m > 2:
        left, right = np.zeros((m - 2, m - 2)), np.zeros((m - 2, m))
        rows = np.arange(m - 2)
        left[rows, rows] = (h[:-1] + h[1:]) / 3.0
        left[rows[1:], rows[:-1]] = left[rows[:-1], rows[1:]] = h[1:-1] / 6.0
        right[rows, rows], right[rows, rows + 2] = 1.0 / h[:-1], 1.0 / h[1:]
        right[rows, rows + 1] = -1.0 / h[:-1] - 1.0 / h[1:]
        bend[inner] = np.linalg.solve(left, right)
    i = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, m - 2)
    b = ((x - nodes[i]) / h[i])[..., None]
    a, sixth = 1.0 - b, np.square(h[i])[..., None] / 6.0
    values = np.eye(m)
    return (
        a * values[i]
        + b * values[i + 1]
        + sixth * ((a**3 - a) * bend[i] + (b**3 - b) * bend[i + 1])
    )


@dataclass(frozen=True)
class Learned(Effect):
    """An empirical term; `learned_kind` makes the class whose fields are the parameters of one
    form.
    """

    name = LEARNED
    physics = "an empirical term, learned from data that no effect of the catalogue explains"
    source = "the data in [origin] of the model file"
    signature = "whatever it was fitted to"
    check = "look for the cause at its place of the chain; outside its range it says nothing"
    form: ClassVar[LearnedForm]

    def _log_factor(self, drive: Drive) -> Values:
        """g, complex where the phase is learned as well."""
        values: list[Values] = [getattr(self, p.name) for p in self.parameters()]
        if self.form.shape == "spline":
            weights = self.form.weights(drive)
            log, phase = (
                sum(w * y for w, y in zip(weights, y_s, strict=False))
                for y_s in (values, values[len(weights) :])
            )
            return log + 1j * phase if self.form.with_phase else log
        each, factors = len(values) // len(self.form.terms), []
        for i, term in enumerate(self.form.terms):
            factors.append(
                self.form.share(term, drive) * self.form.formula(term, values[i * each :], drive)
            )
        return np.asarray(sum(factors))

    def drive(self, drive: Drive) -> Drive:
        if self.form.acts_on != "voltage":
            return drive
        g = self._log_factor(drive)
        phase = drive.voltage_phase_rad + np.imag(g)
        return replace(
            drive, voltage_v=drive.voltage_v * np.exp(np.real(g)), voltage_phase_rad=phase
        )

    def stack(self, branch: Branch, parameters: TouchParameters, drive: Drive) -> Branch:
        if self.form.acts_on not in ("series_impedance", "gap_permittivity", "gap_field"):
            return branch
        factor = np.exp(self._log_factor(drive))
        if self.form.acts_on == "gap_field":
            return replace(branch, field_gain=branch.field_gain * factor)
        if self.form.acts_on == "gap_permittivity":
            return replace(branch, k_gap=branch.k_gap * factor)
        return replace(
            branch, series_length_m=branch.series_length_m + branch.h_m(parameters) * (factor - 1.0)
        )

    def contact(self, contact: Contact, parameters: TouchParameters, drive: Drive) -> Contact:
        if self.form.acts_on != "skin_stiffness":
            return contact
        return replace(
            contact, modulus_factor=contact.modulus_factor * np.exp(self._log_factor(drive))
        )

    def friction(self, friction: Friction, drive: Drive) -> Friction:
        if self.form.acts_on != "friction":
            return friction
        return replace(
            friction, cof_off_factor=friction.cof_off_factor * np.exp(self._log_factor(drive))
        )


@cache
def learned_kind(form: LearnedForm) -> type[Learned]:
    """The effect class of a form: one parameter per node, or those of its formulas."""
    entries: list[tuple[str, type, Any]] = []
    phases: list[tuple[str, type, Any]] = []
    for term in form.terms:
        if form.shape == "spline":
            grid = product(*(range(len(nodes)) for nodes in term.nodes))
            names = [
                "_".join(f"{n}_{i}" for n, i in zip(term.inputs, at, strict=True)) for at in grid
            ]
            entries += [(name, float, _value("1", term.amplitude)) for name in names]
            phases += [(f"{name}_rad", float, _value("rad", term.amplitude)) for name in names]
        else:
            entries += [
                (f"{term.inputs[0]}_{name}", float, p)
                for name, p in _of_formula(form.shape, term).items()
            ]
    entries += phases if form.with_phase else []
    needs = tuple(name for name in NEEDED if any(name in term.inputs for term in form.terms))
    return make_dataclass(
        "Learned",
        entries,
        bases=(Learned,),
        frozen=True,
        namespace={"form": form, "stage": form.place, "needs": needs},
    )


def _value(unit: str, std: float) -> Any:
    return linear_parameter(unit, 0.0, std, (-20.0, 20.0), off=0.0)


def _of_formula(shape: Shape, term: Term) -> Mapping[str, Any]:
    if shape == "power":
        return {"exponent": _value("1", term.amplitude)}
    name, usual = term.inputs[0], middle(term.inputs[0], term.nodes[0])
    scale = log_parameter(UNITS[name], usual, 4.0, (1e-6 * usual, 1e6 * usual), off=usual)
    known = {"amount": _value("1", 2.0 * term.amplitude), "scale": scale}
    if shape == "step":
        known["steepness"] = log_parameter("1", 3.0, 2.0, (0.1, 30.0), off=1.0)
    return known
