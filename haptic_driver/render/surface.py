"""The lookup surface: friction over frequency, normal force and voltage, looked up and inverted.

Nodes are evenly spaced in log frequency, log normal force and voltage; between nodes everything is
linear, outside it is clamped and never extrapolated.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from haptic_driver.render.compiled import kernel
from haptic_driver.signals import Array, FingerState

ON_NODE = 1e-9  # of a cell: so near to a node is the node


class Surface(NamedTuple):
    """A surface made ready for look-up, limits of the rig applied.

    Nodes of log frequency [f], log normal force [n] and voltage [v]. `cof` and `current_rms_a` are
    [f, n, v]. `stuck_current_a_per_v` and `electrode_gain` [f, v - 1] are as in `limits.WorstCase`.
    `voltage_limit_v` [f, n] is the largest voltage that every limit and mask allows there.
    `log_pressure` [n] is the log of load over contact area, rising; empty where friction depends on
    more than their ratio.
    """

    log_frequency: Array
    log_normal_force: Array
    voltage_v: Array
    cof: Array
    current_rms_a: Array
    stuck_current_a_per_v: Array
    electrode_gain: Array
    voltage_limit_v: Array
    log_pressure: Array


class Place(NamedTuple):
    """A frequency and a load: at or after node `i` of frequency by `a` cells, at or after node `j`
    of load by `b`.
    """

    i: int
    a: float
    j: int
    b: float


class Caps(NamedTuple):
    """What else bounds voltage and sliding current: between the nodes the limits of the surface are
    not exact.
    """

    voltage_v: float
    current_a: float


NO_CAPS = Caps(np.inf, np.inf)


class Inverse(NamedTuple):
    """The voltage for a target at one place, and what it gives; `cof_high` is the most that is
    reachable there.
    """

    voltage_v: float
    cof: float
    current_rms_a: float
    stuck_current_rms_a: float
    cof_low: float
    cof_high: float


@kernel
def cof_at(surface: Surface, frequency_hz: float, voltage_v: float, normal_force_n: float) -> float:
    """Friction at one point; clamped to the surface, NaN where an input is NaN. Frequency and force
    are positive.
    """
    return at_voltage(
        surface, surface.cof, place_of(surface, frequency_hz, normal_force_n), voltage_v
    )


@kernel
def invert(
    surface: Surface, target_cof: float, frequency_hz: float, normal_force_n: float, caps: Caps
) -> Inverse:
    """The smallest voltage that gives `target_cof` at that frequency and load, clamped to what is
    reachable there.
    """
    return invert_at(surface, target_cof, place_of(surface, frequency_hz, normal_force_n), caps)


@kernel
def invert_at(surface: Surface, target_cof: float, place: Place, caps: Caps) -> Inverse:
    """The same at a place."""
    most_v = highest_v(surface, place, caps)
    low, high = at_node(surface.cof, place, 0), at_voltage(surface, surface.cof, place, most_v)
    voltage_v, cof = 0.0, low
    if target_cof >= high:
        voltage_v, cof = most_v, high
    elif target_cof > low:
        voltage_v, cof = crossing_v(surface, surface.cof, place, target_cof, most_v), target_cof
    current_a = at_voltage(surface, surface.current_rms_a, place, voltage_v)
    return Inverse(voltage_v, cof, current_a, stuck_a(surface, place, voltage_v), low, high)


@kernel
def stuck_a(surface: Surface, place: Place, voltage_v: float) -> float:
    """Worst-case current at a place and a voltage, A rms; straight on logarithmic axes between
    frequencies.
    """
    k, c = locate(surface.voltage_v, voltage_v)
    cell = k - (c == 0.0 and k > 0)
    here = surface.stuck_current_a_per_v[place.i, cell]
    if place.a == 0.0:
        return float(voltage_v * here)
    there = surface.stuck_current_a_per_v[place.i + 1, cell]
    return float(voltage_v * here ** (1.0 - place.a) * there**place.a)


@kernel
def highest_v(surface: Surface, place: Place, caps: Caps) -> float:
    """The most that limits and caps allow at a place."""
    most_v = min(limit_v(surface, place), caps.voltage_v)
    if at_voltage(surface, surface.current_rms_a, place, most_v) > caps.current_a:
        return (1.0 - ON_NODE) * crossing_v(
            surface, surface.current_rms_a, place, caps.current_a, most_v
        )
    return most_v


@kernel
def highest_cof(surface: Surface) -> Array:
    """Friction at the limit of voltage, for each frequency and load, [f, n, 3].

    At the load itself, and at both ends of the cell between it and the next. In the cell the lower
    of both limits holds, so that friction goes straight from end to end.
    """
    limit_v = surface.voltage_limit_v
    frequencies, loads = limit_v.shape
    highest = np.empty((frequencies, loads, 3))
    for i in range(frequencies):
        for j in range(loads):
            k = min(j + 1, loads - 1)
            here, there = Place(i, 0.0, j, 0.0), Place(i, 0.0, k, 0.0)
            within_v = min(limit_v[i, j], limit_v[i, k])
            highest[i, j, 0] = at_voltage(surface, surface.cof, here, limit_v[i, j])
            highest[i, j, 1] = at_voltage(surface, surface.cof, here, within_v)
            highest[i, j, 2] = at_voltage(surface, surface.cof, there, within_v)
    return highest


@kernel
def limit_v(surface: Surface, place: Place) -> float:
    """The least limit of the nodes around: between an allowed and a forbidden node nothing is
    allowed.
    """
    i, a, j, b = place
    i1, j1, limit = i + (a > 0.0), j + (b > 0.0), surface.voltage_limit_v
    return float(min(limit[i, j], limit[i, j1], limit[i1, j], limit[i1, j1]))


@kernel
def crossing_v(
    surface: Surface, values: Array, place: Place, wanted: float, most_v: float
) -> float:
    """The voltage up to `most_v` at which `values` [f, n, v], which grow with it, reach `wanted`;
    by bisection.
    """
    below, above = 0, locate(surface.voltage_v, most_v)[0] + 1
    while above - below > 1:
        middle = (below + above) // 2
        if at_node(values, place, middle) <= wanted:
            below = middle
        else:
            above = middle
    start, end = at_node(values, place, below), at_node(values, place, above)
    share = (wanted - start) / (end - start)
    return min(between(surface.voltage_v[below], surface.voltage_v[above], share), most_v)


@kernel
def as_solved(surface: Surface, finger: FingerState) -> FingerState:
    """The finger with the load under which the surface's own has the same pressure.

    Friction over load depends on that alone; the pressure is clamped to the surface. It is the
    finger itself where its area is unknown.
    """
    nodes, area_m2 = surface.log_pressure, finger.contact_area_m2
    if nodes.size == 0 or not (0.0 < area_m2 < np.inf and finger.normal_force_n > 0.0):
        return finger
    log_pressure = min(max(np.log(finger.normal_force_n / area_m2), nodes[0]), nodes[-1])
    k = min(int(np.searchsorted(nodes, log_pressure, side="right")), nodes.size - 1) - 1
    share = (log_pressure - nodes[k]) / (nodes[k + 1] - nodes[k])
    loads = surface.log_normal_force
    return FingerState(
        finger.time_s,
        finger.position_x_m,
        finger.position_y_m,
        finger.velocity_x_m_s,
        finger.velocity_y_m_s,
        np.exp(between(loads[k], loads[k + 1], share)),
        finger.in_contact,
        finger.lateral_force_n,
        finger.contact_s,
        finger.met_m_s,
        finger.contact_area_m2,
    )


@kernel
def place_of(surface: Surface, frequency_hz: float, normal_force_n: float) -> Place:
    """Where a frequency and a load lie."""
    i, a = locate(surface.log_frequency, np.log(frequency_hz))
    j, b = locate(surface.log_normal_force, np.log(normal_force_n))
    return Place(i, a, j, b)


@kernel
def locate(nodes: Array, x: float) -> tuple[int, float]:
    """Node at or below `x` and the share of the way to the next, on evenly spaced nodes; clamped.

    A node met to rounding is that node, so that no limit of its neighbour is taken for its own.
    """
    cells = nodes.size - 1
    position = min(max((x - nodes[0]) / (nodes[cells] - nodes[0]) * cells, 0.0), float(cells))
    nearest = np.floor(position + 0.5)
    if abs(position - nearest) < ON_NODE:
        position = nearest
    node = int(position) if position > 0.0 else 0  # NaN has no node
    return node, position - node


@kernel
def at_voltage(surface: Surface, values: Array, place: Place, voltage_v: float) -> float:
    """Values [f, n, v] at a place and a voltage."""
    k, c = locate(surface.voltage_v, voltage_v)
    if c == 0.0:
        return at_node(values, place, k)
    return between(at_node(values, place, k), at_node(values, place, k + 1), c)


@kernel
def at_node(values: Array, place: Place, k: int) -> float:
    """Values [f, n, v] at a place and a node of voltage."""
    i, a, j, b = place
    i1, j1 = i + (a > 0.0), j + (b > 0.0)
    return between(
        between(values[i, j, k], values[i, j1, k], b),
        between(values[i1, j, k], values[i1, j1, k], b),
        a,
    )


@kernel
def between(first: float, second: float, share: float) -> float:
    """Some share of the way from one number to another."""
    return (1.0 - share) * first + share * second
