"""`haptic explore`: what the model predicts beyond the paper's figures, as pictures and tables."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from typer import Option

from haptic_driver.cli.output import Json, ModelOption, report, status, stdout
from haptic_driver.files import write_rows
from haptic_driver.lab.pictures import model as pictures
from haptic_driver.lookup.models import load_model
from haptic_driver.signals import Array
from model.analysis import spectra
from model.conditions import Conditions
from model.effects import CATALOGUE
from model.parameters import Parameter
from model.touch_model import TouchModel

MODULATION_HZ, MODULATION_DEPTH = 100.0, 0.5
LOWEST_CARRIER_HZ = 1e3  # of the modulated drive: it has to lie well above what modulates it
IMPEDANCE_HZ = np.geomspace(1.0, 1e6, 241)
STEEP_HZ, STEEP_V = np.geomspace(1.0, 1e6, 121), np.linspace(0.0, 250.0, 126)
LOADS_N, SPEEDS_M_S = np.geomspace(0.05, 5.0, 81), np.geomspace(1e-3, 0.3, 81)
VOLTAGES = (0.5, 1.0, 1.5)  # of the asked one, over load
# above the prior's median: how strongly an effect of speed is switched on to be shown
SHOWN_DEVIATIONS = 1.0

Rows = list[dict[str, str | float]]


class _Asked(NamedTuple):
    touch: TouchModel
    frequency_hz: float
    voltage_v: float
    normal_force_n: float


def explore(
    out: Annotated[Path, Option(help="Folder for the pictures and tables.")] = Path("exploration"),
    model: ModelOption = "reference",
    frequency: Annotated[float, Option(help="Hz.", min=1.0, max=1e6)] = 250.0,
    voltage: Annotated[float, Option(help="V peak at the electrode.", min=1.0, max=1e3)] = 75.0,
    normal_force: Annotated[float, Option(help="N.", min=0.01, max=50.0)] = 0.5,
    as_json: Json = False,
) -> None:
    """Draw the force's spectrum under several drives, the impedance, where force turns steep, and
    friction.

    Friction is drawn over normal force, and over speed with each effect of speed switched on in
    turn. Beside each picture lies its table.

    Example: `haptic explore --out exploration --frequency 250 --voltage 75`
    """
    asked = _Asked(TouchModel(load_model(model)), frequency, voltage, normal_force)
    files = []
    with status("exploring") as tell:
        for name, draw in PARTS.items():
            tell(name)
            picture, table = out / f"{name}.png", out / f"{name}.csv"
            write_rows(table, draw(asked, picture))
            files += [str(picture), str(table)]

    def show() -> None:
        for file in files:
            stdout.print(file)

    report(as_json, {"model": asked.touch.description.name, "files": files}, show)


def _force_spectra(asked: _Asked, picture: Path) -> Rows:
    """Lines of the force of a sine, a biased sine, a square wave and a modulated carrier."""
    f, v = asked.frequency_hz, asked.voltage_v
    carrier = max(f, LOWEST_CARRIER_HZ)
    drives = {
        f"sine, {f:g} Hz, {v:g} V": spectra.sine(f, v),
        f"the same on {v:g} V of bias": spectra.sine(f, v, v),
        f"square wave, {f:g} Hz, {v:g} V": spectra.square(f, v),
        f"carrier {carrier:g} Hz, {v:g} V, modulated at {MODULATION_HZ:g} Hz by half": (
            spectra.amplitude_modulated(carrier, v, MODULATION_HZ, MODULATION_DEPTH)
        ),
    }
    found = {
        name: spectra.force_spectrum(asked.touch, tones, asked.normal_force_n)
        for name, tones in drives.items()
    }
    pictures.draw_force_spectra(found, picture)
    return [
        {
            "drive": name,
            "frequency_hz": f,
            "force_n": abs(force),
            "phase_deg": float(np.degrees(np.angle(force))),
        }
        for name, spectrum in found.items()
        for f, force in zip(spectrum.frequency_hz.tolist(), spectrum.force_n.tolist(), strict=True)
    ]


def _impedance(asked: _Asked, picture: Path) -> Rows:
    """Of the sliding finger under the asked and four times the asked load, and stuck or wet."""
    light, heavy = asked.normal_force_n, 4.0 * asked.normal_force_n
    touch = partial(spectra.impedance, asked.touch, IMPEDANCE_HZ)
    found = {f"sliding, {n:g} N": touch(n) for n in (light, heavy)} | {
        "stuck or wet": touch(light, stuck=True)
    }
    pictures.draw_impedance(IMPEDANCE_HZ, found, picture)
    return [
        {"touch": name, "frequency_hz": f, "resistance_ohm": z.real, "reactance_ohm": z.imag}
        for name, impedance in found.items()
        for f, z in zip(IMPEDANCE_HZ.tolist(), impedance.tolist(), strict=True)
    ]


def _steepness(asked: _Asked, picture: Path) -> Rows:
    """d ln(force)/d ln(voltage), and where the contact pulls in."""
    found = spectra.steepness(asked.touch, STEEP_HZ, STEEP_V, np.array([asked.normal_force_n]))
    pictures.draw_steepness(found, 0, picture)
    return [
        {
            "frequency_hz": float(f),
            "voltage_v": float(v),
            "exponent": float(found.exponent[i, j, 0]),
        }
        for i, f in enumerate(STEEP_HZ)
        for j, v in enumerate(STEEP_V)
        if np.isfinite(found.exponent[i, j, 0])
    ]


def _friction_over_load(asked: _Asked, picture: Path) -> Rows:
    """Without voltage, and at half, once and one and a half times the asked one."""
    voltages = [0.0, *(share * asked.voltage_v for share in VOLTAGES)]
    curves = {f"{v:g} V": _cof(asked, voltage_v=v, normal_force_n=LOADS_N) for v in voltages}
    return _drawn(
        curves, LOADS_N, "normal_force_n", "normal force, N", f"{asked.frequency_hz:g} Hz", picture
    )


def _friction_over_speed(asked: _Asked, picture: Path) -> Rows:
    """As the model has it, and with each effect of speed that it has not."""
    base = asked.touch.description
    curves = {"by the model": _cof(asked, speed_m_s=SPEEDS_M_S)}
    for kind in CATALOGUE:
        if "speed_m_s" in kind.needs and kind.name not in base.effect_parameters:
            shown = {
                p.name: Parameter(p.from_normal(SHOWN_DEVIATIONS), p.unit, "shown")
                for p in kind.parameters()
            }
            more = replace(base, effect_parameters={**base.effect_parameters, kind.name: shown})
            curves[kind.name.replace("_", " ")] = _cof(
                asked._replace(touch=TouchModel(more)), speed_m_s=SPEEDS_M_S
            )
    at = f"{asked.frequency_hz:g} Hz, {asked.voltage_v:g} V"
    return _drawn(curves, SPEEDS_M_S, "speed_m_s", "sliding speed, m/s", at, picture)


def _cof(asked: _Asked, **varied: Any) -> Array:
    """Friction where one condition varies and the others are as asked."""
    conditions = {"frequency_hz": asked.frequency_hz, "voltage_v": asked.voltage_v} | varied
    conditions = {"normal_force_n": asked.normal_force_n} | conditions
    columns = np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for x in conditions.values()))
    return asked.touch.predict(Conditions(**dict(zip(conditions, columns, strict=True)))).cof


def _drawn(
    curves: dict[str, Array], x: Array, column: str, label: str, at: str, picture: Path
) -> Rows:
    pictures.draw_lines(
        {name: (x, cof) for name, cof in curves.items()},
        label,
        f"coefficient of friction, {at}",
        picture,
    )
    return [
        {"curve": name, column: float(a), "cof": float(b)}
        for name, cof in curves.items()
        for a, b in zip(x, cof, strict=True)
    ]


PARTS: dict[str, Callable[[_Asked, Path], Rows]] = {
    "force-spectra": _force_spectra,
    "impedance": _impedance,
    "steepness": _steepness,
    "friction-load": _friction_over_load,
    "friction-speed": _friction_over_speed,
}
