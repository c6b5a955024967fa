"""Measurement designs: which conditions are measured, in which order, and which columns are
written.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from .touch import STEADY_SPEED, Rows

DECADES = np.array([1.0, 10.0, 50.0, 100.0, 250.0, 500.0, 1e3, 1e4, 1e5, 1e6])
SPEEDS = np.array([0.005, 0.01, 0.02, 0.05, 0.1])
LOADS = np.array([0.3, 0.5, 1.0])
SLIDING, RESTING, NONE = 0, 1, 2
SWEEP_V, LOW_SWEEP_V = 5.0, 1.0
Generator = np.random.Generator


@dataclass(frozen=True)
class Design:
    """Planned rows in measuring order. `columns` are the optional ones that are written."""

    name: str
    rows: Rows
    session: np.ndarray
    trial: np.ndarray
    columns: tuple[str, ...]
    bad: bool = False
    finger: np.ndarray | None = None  # SLIDING, RESTING or NONE; without it every row slides
    slides: np.ndarray | None = None  # rows of friction; the others are of a sweep

    @property
    def has_session(self) -> bool:
        return "session" in self.columns


@dataclass
class _Plan:
    """Collects blocks of (f, V, N, speed); one block is one session and one trial, shuffled before
    it is stored.
    """

    rng: Generator
    pause_s: float
    parts: list[tuple] = field(default_factory=list)
    clock: dict[int, float] = field(default_factory=dict)

    def block(self, conditions: np.ndarray, session: int, trial: int) -> None:
        live = self.rng.permutation(conditions[conditions[:, 1] > 0])
        off = self.rng.permutation(conditions[conditions[:, 1] == 0])
        slots = (
            np.sort(self.rng.permutation(len(live) + 1)[: len(off)])
            if len(off) <= len(live)
            else None
        )
        slots = np.linspace(0, len(live), len(off)).astype(int) if slots is None else slots
        rows = np.insert(live, slots, off, axis=0) if len(off) else live
        start = self.clock.get(session, 0.0)
        t = start + self.pause_s * (np.arange(len(rows)) + self.rng.uniform(0.0, 0.3, len(rows)))
        self.clock[session] = start + self.pause_s * (len(rows) + 1)
        self.parts.append((rows, t, np.full(len(rows), session), np.full(len(rows), trial)))

    def build(self, name: str, columns: tuple[str, ...], bad: bool = False) -> Design:
        table = np.concatenate([p[0] for p in self.parts])
        t, session, trial = (np.concatenate([p[i] for p in self.parts]) for i in (1, 2, 3))
        before = np.zeros(len(table))
        for one in np.unique(session):
            mine = np.flatnonzero(session == one)
            before[mine[1:]] = table[mine[:-1], 1]
        rows = Rows(*table.T, np.round(t, 1), before)
        return Design(name, rows, session, trial, columns, bad)


def _grid(f, v, n=(0.5,), speed=(STEADY_SPEED,)) -> np.ndarray:
    return np.array(np.meshgrid(f, v, n, speed, indexing="ij")).reshape(4, -1).T


def _off(count: int, n=(0.5,), speed=(STEADY_SPEED,)) -> np.ndarray:
    """Rows without voltage: `count` at each load and speed, their frequency (ignored by contract)
    set to 250 Hz.
    """
    return np.repeat(_grid([250.0], [0.0], n, speed), count, axis=0)


def paper(rng: Generator) -> Design:
    plan = _Plan(rng, 20.0)
    for session in range(1, 4):
        for trial in range(1, 4):
            plan.block(np.concatenate([_grid(DECADES, [75.0]), _off(2)]), session, trial)
    return plan.build("paper", ("cof_std", "session", "trial"))


def voltage_frequency(rng: Generator) -> Design:
    plan = _Plan(rng, 15.0)
    for trial in range(1, 3):
        plan.block(
            np.concatenate([_grid(DECADES, [25.0, 50.0, 75.0, 100.0, 125.0]), _off(10)]), 1, trial
        )
    return plan.build("voltage_frequency", ("cof_std", "trial"))


def factorial(rng: Generator) -> Design:
    plan = _Plan(rng, 15.0)
    for session in range(1, 4):
        cells = _grid([10.0, 100.0, 250.0, 1e3, 1e4, 1e5], [40.0, 70.0, 100.0], LOADS)
        plan.block(np.concatenate([cells, _off(4, LOADS)]), session, 1)
    return plan.build("factorial", ("cof_std", "session", "trial"))


def speed_sweep(rng: Generator) -> Design:
    plan = _Plan(rng, 15.0)
    for session in range(1, 3):
        cells = _grid([10.0, 100.0, 250.0, 1e3, 1e5], [50.0, 100.0], [0.5], SPEEDS)
        plan.block(np.concatenate([cells, _off(3, speed=SPEEDS)]), session, 1)
    return plan.build("speed_sweep", ("cof_std", "session", "speed_m_s"))


def timed(rng: Generator) -> Design:
    plan = _Plan(rng, 20.0)
    for session in range(1, 3):
        cells = _grid([5.0, 30.0, 100.0, 250.0, 1e3, 1e4, 2e5], [50.0, 75.0, 100.0], [0.4, 0.8])
        plan.block(np.concatenate([cells, _off(5, [0.4, 0.8])]), session, 1)
    return plan.build("timed", ("cof_std", "session", "time_s"))


def six_sessions(rng: Generator) -> Design:
    plan = _Plan(rng, 20.0)
    cells = _grid(DECADES, [40.0, 70.0, 100.0], LOADS, SPEEDS[1:4])
    for session in range(1, 7):
        chosen = cells[rng.choice(len(cells), 33, replace=False)]
        plan.block(np.concatenate([chosen, _off(2, LOADS)]), session, 1)
    return plan.build("six_sessions", ("cof_std", "session", "time_s", "speed_m_s"))


def rich(rng: Generator) -> Design:
    plan = _Plan(rng, 12.0)
    cells = _grid(np.logspace(0, 6, 13), [30.0, 50.0, 75.0, 100.0, 120.0], LOADS, SPEEDS)
    for session in range(1, 6):
        chosen = cells[rng.choice(len(cells), 85, replace=False)]
        plan.block(np.concatenate([chosen, _off(1, LOADS, SPEEDS)]), session, 1)
    return plan.build("rich", ("cof_std", "session", "trial", "time_s", "speed_m_s"))


def quiet_grid(rng: Generator) -> Design:
    """Three trials per condition and no cof_std: the noise must be read from replicates."""
    plan = _Plan(rng, 15.0)
    for session in range(1, 4):
        for trial in range(1, 4):
            plan.block(
                np.concatenate(
                    [_grid(DECADES[::2], [50.0, 100.0], [0.4, 0.8]), _off(2, [0.4, 0.8])]
                ),
                session,
                trial,
            )
    return plan.build("quiet_grid", ("session", "trial", "time_s"))


def witnesses(rng: Generator) -> Design:
    """Friction within a rig's touch-current limits, then spectra at 5 V: open, resting and sliding,
    two loads.

    And one of two decades at 1 V, as the plan `witnesses` has it: what is linear is the same there.
    """
    plan = _Plan(rng, 12.0)
    high = _grid([10.0, 50.0, 125.0, 250.0], [75.0, 125.0])
    crossed = _grid([30.0, 250.0], [100.0], [0.25, 1.0], [0.01, 0.04])
    for session in range(1, 4):
        plan.block(
            np.concatenate([high, crossed, _off(2), _off(1, [0.25, 1.0], [0.01, 0.04])]), session, 1
        )
    friction = sum(len(part[0]) for part in plan.parts)
    finger = [np.full(friction, SLIDING)]
    spectrum = np.logspace(1, 6, 11)
    for session in (1, 2):
        for kind, load in ((NONE, 0.5), *((k, n) for k in (RESTING, SLIDING) for n in (0.25, 1.0))):
            plan.block(_grid(spectrum, [SWEEP_V], [load]), session, 1)
            finger.append(np.full(spectrum.size, kind))
        plan.block(_grid(spectrum[spectrum >= 1e4], [LOW_SWEEP_V]), session, 1)
        finger.append(np.full(np.sum(spectrum >= 1e4), SLIDING))
    columns = ("cof_std", "session", "trial", "time_s", "speed_m_s")
    design = plan.build("witnesses", columns)
    slides = np.arange(design.session.size) < friction
    return replace(design, finger=np.concatenate(finger), slides=slides)


def sliding(design: Design) -> Design:
    """The rows with friction, as rows of a design that says so."""
    part = friction_only(design)
    count = part.session.size
    return replace(part, finger=np.full(count, SLIDING), slides=np.ones(count, bool))


def between(rng: Generator, design: Design, count: int) -> Design:
    """Settings between those of a design whose rows slide: each lies between two rows with
    voltage, frequency and speed by their logarithms.
    """
    driven = np.flatnonzero(design.rows.v > 0)
    first, second = rng.choice(driven, (2, count))
    share = rng.uniform(size=count)

    def mixed(values: np.ndarray) -> np.ndarray:
        return values[first] + share * (values[second] - values[first])

    rows = design.rows
    return replace(
        design,
        rows=replace(
            rows.take(first),
            f=np.exp(mixed(np.log(rows.f))),
            v=mixed(rows.v),
            n=mixed(rows.n),
            speed=np.exp(mixed(np.log(rows.speed))),
            time=mixed(rows.time),
        ),
        session=design.session[first],
        trial=design.trial[first],
        finger=np.full(count, SLIDING),
        slides=np.ones(count, bool),
    )


def friction_only(design: Design) -> Design:
    """The rows of friction alone, as a lab without monitors would have them."""
    keep = design.slides
    return Design(
        design.name,
        design.rows.take(keep),
        design.session[keep],
        design.trial[keep],
        design.columns,
    )


def confounded(rng: Generator) -> Design:
    """Voltage rises with frequency, so no row tells one from the other."""
    plan = _Plan(rng, 15.0)
    pairs = _grid(DECADES, [0.0])
    pairs[:, 1] = np.linspace(35.0, 125.0, len(DECADES))
    for session in range(1, 4):
        plan.block(np.concatenate([pairs, pairs, _off(4)]), session, 1)
    return plan.build("confounded", ("cof_std", "session"), bad=True)


def small(rng: Generator) -> Design:
    plan = _Plan(rng, 15.0)
    plan.block(
        np.concatenate(
            [_grid(DECADES[1::2], [50.0, 75.0, 100.0], [0.4, 0.8]), _off(5, [0.4, 0.8])]
        ),
        1,
        1,
    )
    return plan.build("small", ("cof_std",), bad=True)


def narrow(rng: Generator) -> Design:
    plan = _Plan(rng, 15.0)
    for session in range(1, 4):
        cells = _grid([150.0, 200.0, 250.0, 300.0], [50.0, 75.0, 100.0], [0.5])
        plan.block(np.concatenate([cells, cells, _off(4)]), session, 1)
    return plan.build("narrow", ("cof_std", "session"), bad=True)


def missing_corner(rng: Generator) -> Design:
    """No row has both a high frequency and a high voltage."""
    plan = _Plan(rng, 15.0)
    cells = _grid(DECADES, [25.0, 50.0, 75.0, 100.0])
    cells = cells[(cells[:, 0] < 400) | (cells[:, 1] < 60)]
    for session in range(1, 4):
        plan.block(np.concatenate([cells, _off(5)]), session, 1)
    return plan.build("missing_corner", ("cof_std", "session"), bad=True)


def no_noise_stated(rng: Generator) -> Design:
    """Neither replicates nor cof_std: nothing says how noisy the rows are."""
    plan = _Plan(rng, 15.0)
    cells = _grid(np.logspace(0, 6, 9), [30.0, 50.0, 75.0, 100.0], [0.5])
    plan.block(np.concatenate([cells, _off(1)]), 1, 1)
    return plan.build("no_noise_stated", (), bad=True)


GOOD: dict[str, Callable[[Generator], Design]] = {
    made.__name__: made
    for made in (
        paper,
        voltage_frequency,
        factorial,
        speed_sweep,
        timed,
        six_sessions,
        rich,
        quiet_grid,
    )
}
BAD: dict[str, Callable[[Generator], Design]] = {
    made.__name__: made for made in (confounded, small, narrow, missing_corner, no_noise_stated)
}
DESIGNS = GOOD | BAD
