"""The operating point that gives a friction within a rig's limits, without a rig."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from haptic_driver.errors import BadInputError, HapticError, require_range
from haptic_driver.limits import OperatingLimits
from haptic_driver.lookup.file import SurfaceFile, ready_for_lookup
from haptic_driver.render.controller import INITIAL, Controller, ControllerSettings
from haptic_driver.render.policies import POLICIES
from haptic_driver.render.safety import Worst, table_of, violation, worst_at
from haptic_driver.signals import NO_COMMAND, FingerState, OperatingPoint, TargetFriction
from model import friction as friction_law
from model.support.errors import nearest


def controller_by(
    file: SurfaceFile,
    limits: OperatingLimits,
    settings: Mapping[str, Any],
    policy: str | None = None,
    frequency_hz: float | None = None,
) -> Controller:
    """A controller over a surface, by the settings of a rig's file where nothing else is said.

    `policy` is a name of `POLICIES`; with a `frequency_hz` it is `fixed_frequency`. BadInputError
    for an unknown policy, and for a frequency that the policy would choose itself.
    """
    chosen = _policy(policy, frequency_hz, settings["policy"])
    own = dict(settings) | {"policy": chosen}
    if frequency_hz is not None:
        own["fixed_frequency_hz"] = frequency_hz
    if chosen == "fixed_frequency" and own["fixed_frequency_hz"] is None:
        raise BadInputError(
            "bad_frequency",
            "policy fixed_frequency needs a frequency",
            "Give one in Hz (--frequency)",
        )
    return Controller(ControllerSettings(ready_for_lookup(file, limits), limits, **own))


def operating_point(
    controller: Controller, file: SurfaceFile, friction: float, normal_force_n: float
) -> OperatingPoint:
    """Find the point that the controller chooses for a finger at rest.

    BadInputError where the friction is out of reach, HapticError where the safety gate refuses the
    point.
    """
    require_range("friction", friction, 1e-3, 10.0)
    require_range("normal force", normal_force_n, *file.normal_force_n[[0, -1]].tolist(), unit=" N")
    finger = FingerState(0.0, 0.0, 0.0, 0.0, 0.0, normal_force_n, True)
    _, point = controller.step(INITIAL, TargetFriction(friction, True), finger, NO_COMMAND)
    if not point.reachable:
        low, high = controller.reachable(normal_force_n)
        said = (
            f"friction {friction:g} cannot be reached at {normal_force_n:g} N by policy"
            f" {controller.settings.policy}"
        )
        raise BadInputError("unreachable", said, f"Reachable: {low:.4g} to {high:.4g}")
    limits = controller.settings.limits
    table = table_of(file.worst_case(limits))
    worst = Worst(*worst_at(table, point.frequency_hz, point.voltage_v))
    refused = violation(limits, point, worst)
    if refused is not None:
        raise HapticError(
            "refused",
            f"the safety gate refuses the point found: {refused}",
            "Check the rig's limits",
        )
    return point


def electrostatic_force_n(file: SurfaceFile, cof: float, normal_force_n: float) -> float:
    """The force that raises friction from that without voltage to `cof`, by the model's law."""
    model = file.provenance["model"]
    cof_off = float(model["parameters"]["cof_off"]["value"])
    force = friction_law.electrostatic_force_n(
        model["friction_law"], cof_off, np.array(cof), np.array(normal_force_n)
    )
    return float(force)


def _policy(name: str | None, fixed_hz: float | None, default: str) -> str:
    if name is None:
        return default if fixed_hz is None else "fixed_frequency"
    if name not in POLICIES:
        said = f"there is no policy '{name}'"
        raise BadInputError("bad_policy", said, nearest(name, list(POLICIES)))
    if fixed_hz is not None and name != "fixed_frequency":
        said = f"policy {name} chooses the frequency itself"
        raise BadInputError("bad_policy", said, "Leave --frequency auto, or frequency_hz out")
    return name
