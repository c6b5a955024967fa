"""Policies: how the carrier is chosen. A new one is a function here, found by its name.

A policy is asked once, when a controller is made, and ranks the frequencies of the surface. The
compiled stages see that ranking alone (`choice.py`), so a new policy compiles nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.render.choice import Choice
from haptic_driver.signals import Array

if TYPE_CHECKING:
    from haptic_driver.render.controller import ControllerSettings


Policy = Callable[["ControllerSettings"], Choice]
POLICIES: dict[str, Policy] = {}


def policy(function: Policy) -> Policy:
    """Let a function be found by its name; the first line of its docstring describes it."""
    POLICIES[function.__name__] = function
    return function


def description(name: str) -> str:
    """The sentence that describes a policy."""
    return (POLICIES[name].__doc__ or "").partition("\n")[0]


def chosen_by(settings: ControllerSettings) -> Choice:
    """What the policy of these settings says; BadInputError where it leaves no carrier."""
    name = settings.policy
    if name not in POLICIES:
        hint = f"Known: {', '.join(POLICIES)}"
        raise BadInputError("bad_policy", f"there is no policy '{name}'", hint)
    choice = POLICIES[name](settings)
    if np.isnan(choice.fixed_hz) and not np.isfinite(choice.rank).any():
        low, high = np.exp(settings.surface.log_frequency[[0, -1]])
        said = f"policy {name} finds no frequency on a surface of {low:g}..{high:g} Hz"
        raise BadInputError("bad_frequency", said, "Build a surface that reaches higher")
    return choice


def from_hz(settings: ControllerSettings, lowest_hz: float) -> Array:
    """The rank [f] that takes any frequency from `lowest_hz` on, and none below."""
    is_allowed = settings.surface.log_frequency >= np.log(lowest_hz) - 1e-9
    return np.where(is_allowed, 1.0, np.inf)


@policy
def max_authority(settings: ControllerSettings) -> Choice:
    """The carrier reaches the highest friction within the limits."""
    return Choice(from_hz(settings, settings.lowest_carrier_hz))


@policy
def min_voltage(settings: ControllerSettings) -> Choice:
    """The carrier needs the least voltage for the target."""
    return Choice(from_hz(settings, settings.lowest_carrier_hz), cost_per_v=1.0)


@policy
def min_current(settings: ControllerSettings) -> Choice:
    """The carrier needs the least finger current for the target."""
    return Choice(from_hz(settings, settings.lowest_carrier_hz), cost_per_a=1e6)


@policy
def fixed_frequency(settings: ControllerSettings) -> Choice:
    """The carrier is the frequency that you give.

    Between the surface's nodes the limits hold exactly, and `lowest_carrier_hz` does not count.
    """
    low, high = np.exp(settings.surface.log_frequency[[0, -1]])
    hz = settings.fixed_frequency_hz
    if hz is None or not low * (1 - 1e-9) <= hz <= high * (1 + 1e-9):
        wrong = "no frequency is given" if hz is None else f"{hz:g} Hz is not on the surface"
        hint = f"Give fixed_frequency_hz of {low:g}..{high:g} Hz"
        raise BadInputError("bad_frequency", f"policy fixed_frequency: {wrong}", hint)
    return Choice(from_hz(settings, hz), fixed_hz=hz)


@policy
def carrier(settings: ControllerSettings) -> Choice:
    """The carrier is at least 10 kHz, and reaches the highest friction from there on."""
    return Choice(from_hz(settings, 10e3))


@policy
def quiet(settings: ControllerSettings) -> Choice:
    """The carrier's ripple is not felt, as long as such a carrier reaches the target.

    The ripple is at twice the carrier, and counts as not felt from `quiet_above_hz` on. A target
    beyond the reach of those carriers gets the highest carrier that reaches it. That one is found
    in steps of a third of an octave, so that the carrier does not follow every change of a target.
    """
    ripple_hz = 2.0 * np.exp(settings.surface.log_frequency)
    thirds = np.ceil(3.0 * np.log2(settings.quiet_above_hz / ripple_hz) - 1e-9)
    loudness = 2.0 ** (np.maximum(thirds, 0.0) / 3.0)
    return Choice(from_hz(settings, settings.lowest_carrier_hz) * loudness)
