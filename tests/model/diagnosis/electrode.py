"""A finger on leads with a capacitance of their own, measured by friction and at the electrode."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from model.conditions import Conditions
from model.description import ModelDescription
from model.parameters import Parameter
from model.touch_model import TouchModel
from tests.fingers import FINGER, hiding

STRAY_F = 300e-12


def with_stray(
    finger: ModelDescription, farads: float, std: float | None = None
) -> ModelDescription:
    return replace(
        finger,
        parameters=finger.parameters | {"stray_capacitance_f": Parameter(farads, "F", "", std)},
    )


def hidden(**effects: dict[str, float]) -> ModelDescription:
    """A finger with effects, and leads, that the reference knows nothing of."""
    return hiding(with_stray(FINGER, STRAY_F), **effects)


def measured(path: Path, finger: ModelDescription, seed: int, other_touches: float = 0.0) -> None:
    """Friction up to 2 kHz in two sessions; then sweeps at 5 V, sliding, resting and without a
    finger.

    `other_touches`: their current beside the finger's, as a share of that.
    """
    rng = np.random.default_rng(seed)
    rows = [
        (s, f, v, n, "sliding", True)
        for s in "ab"
        for n in (0.25, 0.5)
        for f in (20.0, 100.0, 500.0, 2e3)
        for v in ((0.0, 50.0, 90.0) if f < 1e3 else (40.0,))
    ]
    rows += [
        ("d", f, 5.0, 0.5, state, False)
        for state in ("sliding", "resting", "none")
        for f in np.logspace(1, 6, 7)
    ]
    session, f, v, n, state, slides = (np.array(column) for column in zip(*rows, strict=True))
    answer = TouchModel(finger).predict(Conditions(f, v, n, finger=state))
    nobody = TouchModel(finger).predict(Conditions(f, v, n, finger=np.full(f.size, "none")))
    of_finger_a = answer.electrode_current_a - nobody.electrode_current_a
    gain = dict(zip("abd", 0.03 * rng.standard_normal(3), strict=True))
    cof = answer.cof * np.exp(0.01 * rng.standard_normal(f.size) + [gain[s] for s in session])
    noise = 0.01 * rng.standard_normal(f.size) + 0.02j * rng.standard_normal(f.size)
    current = (answer.electrode_current_a + other_touches * of_finger_a) * np.exp(noise)
    voltage = answer.electrode_voltage_v * np.exp(0.005 * rng.standard_normal(f.size))
    phase = np.angle(answer.electrode_voltage_v) + 0.005 * rng.standard_normal(f.size)
    lines = [
        "frequency_hz,voltage_v,normal_force_n,session,finger,cof,cof_std,current_a,current_std_a,"
        "current_phase_rad,current_phase_std_rad,electrode_voltage_v,electrode_voltage_std_v,"
        "electrode_voltage_phase_rad,electrode_voltage_phase_std_rad"
    ]
    for i in range(f.size):
        friction = f"{cof[i]:.8g},{0.01 * cof[i]:.8g}" if slides[i] else ","
        size = abs(current[i])
        electrical = (
            f"{size:.8g},{0.01 * size:.8g},{np.angle(current[i]):.8g},0.02,"
            f"{abs(voltage[i]):.8g},{0.005 * abs(voltage[i]):.8g},{phase[i]:.8g},0.005"
        )
        electrical = electrical if v[i] else ",,,,,,,"
        lines.append(f"{f[i]:.8g},{v[i]},{n[i]},{session[i]},{state[i]},{friction},{electrical}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
