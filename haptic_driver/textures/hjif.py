"""Friction from MPEG .hjif files (ISO/IEC 23090-31, the JSON form): one curve of friction along a
line.

In the reference software (MPEGGroup/HapticReferenceSoftware, 2de9ff1) the modality Friction is
spatial: positions of effects and keyframes are distances, in units of 10^`unit_exponent` m.
Keyframes are met exactly; which end conditions the standard gives its cubic curves was not
verified.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.signals import Array
from haptic_driver.textures.description import FINEST_MM
from model.support.reading import read_text

MODALITY = "Friction"
CURVES = ("Linear", "Cubic", "Akima")  # Bezier and Bspline do not pass through their keyframes
LARGEST_CURVE_POINTS = 100_000
SUPPORTED = (
    "supported: one perception Friction, one channel, one band Curve (Linear, Cubic, Akima), one"
    " effect Basis"
)
DEFAULT_UNIT_EXPONENT = -3
LARGEST_EXPONENT = 9


def read(path: Path) -> tuple[Array, Array]:
    """Positions in metres, increasing, and amplitudes 0 to 1 of the one friction curve in a .hjif
    file.
    """
    if path.suffix.lower() == ".hmpg":
        raise _refused(path, "is a binary .hmpg file", "export the effect as .hjif, which is JSON")
    perception = _friction(path, _json(path))
    where = f"{path}: perception {perception.get('id', '?')}"
    channel = _only(where, "channels", perception.get("channels", perception.get("tracks")))
    _refuse_vertices(where, channel)
    band = _only(where, "bands", channel.get("bands"))
    if band.get("band_type") != "Curve":
        raise _refused(where, f"has a band of type {band.get('band_type')}", SUPPORTED)
    effect = _only(where, "effects", band.get("effects"))
    if effect.get("effect_type", "Basis") != "Basis":
        raise _refused(where, f"has an effect of type {effect.get('effect_type')}", SUPPORTED)
    position, amplitude = _keyframes(where, effect)
    amplitude = amplitude * _number(where, channel, "gain", 1.0)
    if not np.all((amplitude >= 0.0) & (amplitude <= 1.0)):
        said = f"has amplitudes {amplitude.min():.4g} to {amplitude.max():.4g}"
        raise _refused(where, said, "keep amplitude_modulation times gain in 0 to 1")
    exponent = _number(where, perception, "unit_exponent", DEFAULT_UNIT_EXPONENT)
    if abs(exponent) > LARGEST_EXPONENT:
        raise _refused(where, f"has unit_exponent = {exponent:g}", "-3 means mm")
    unit_m = 10.0**exponent
    position_m, amplitude = _curve(
        where, band.get("curve_type", "Cubic"), position * unit_m, amplitude
    )
    return position_m, np.clip(amplitude, 0.0, 1.0)  # a curve may overshoot its keyframes


def _json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise _refused(
            path, f"is not JSON: {error}", "a .hjif file is JSON; binary files are not supported"
        ) from None
    if not isinstance(content, dict) or not isinstance(content.get("perceptions"), list):
        raise _refused(path, "has no list 'perceptions'", "is it a .hjif file?")
    return content


def _friction(path: Path, content: dict[str, Any]) -> dict[str, Any]:
    perceptions = [p for p in content["perceptions"] if isinstance(p, dict)]
    modalities = [str(p.get("perception_modality")) for p in perceptions]
    if modalities.count(MODALITY) != 1:
        raise _refused(path, f"has the perceptions {', '.join(modalities) or 'none'}", SUPPORTED)
    return perceptions[modalities.index(MODALITY)]


def _only(where: str, what: str, items: Any) -> dict[str, Any]:
    if not isinstance(items, list) or len(items) != 1 or not isinstance(items[0], dict):
        count = len(items) if isinstance(items, list) else "no"
        raise _refused(where, f"has {count} {what}", SUPPORTED)
    only: dict[str, Any] = items[0]
    return only


def _refuse_vertices(where: str, channel: dict[str, Any]) -> None:
    if channel.get("vertices"):
        raise _refused(
            where, "is bound to vertices of an avatar", "remove 'vertices': a screen has no mesh"
        )
    direction = channel.get("direction")
    if direction and any(direction.values() if isinstance(direction, dict) else direction):
        said = "has a direction"
        raise _refused(
            where,
            said,
            "remove 'direction', and give direction_deg in the texture's .toml file instead",
        )


def _keyframes(where: str, effect: dict[str, Any]) -> tuple[Array, Array]:
    keyframes = effect.get("keyframes")
    if not isinstance(keyframes, list) or not all(isinstance(k, dict) for k in keyframes):
        raise _refused(where, "has an effect without keyframes", SUPPORTED)
    shaped = [k for k in keyframes if k.get("amplitude_modulation") is not None]
    start = _number(where, effect, "position", 0.0)
    position = np.array([start + _number(where, k, "relative_position", 0.0) for k in shaped])
    amplitude = np.array([_number(where, k, "amplitude_modulation", 0.0) for k in shaped])
    if len(shaped) < 2 or not np.all(np.diff(position) > 0.0):
        said = (
            f"has {len(shaped)} keyframes with amplitude_modulation, or their positions do not"
            " increase"
        )
        raise _refused(where, said, "give at least two, with rising relative_position")
    return position, amplitude


def _curve(where: str, kind: Any, position_m: Array, amplitude: Array) -> tuple[Array, Array]:
    """The keyframes themselves where lines join them, else points of the curve no further apart
    than 0.1 mm.
    """
    if kind not in CURVES:
        raise _refused(where, f"has a curve of type {kind}", SUPPORTED)
    # the reference software joins two keyframes by a line
    if kind == "Linear" or len(position_m) == 2:
        return position_m, amplitude
    if not np.all(np.diff(position_m) > 0.0):
        raise _refused(
            where,
            "has keyframes closer together than numbers can tell",
            "check unit_exponent: -3 means mm",
        )
    count = math.ceil((position_m[-1] - position_m[0]) / (FINEST_MM * 1e-3))
    if count > LARGEST_CURVE_POINTS:
        raise _refused(
            where,
            f"is {position_m[-1] - position_m[0]:g} m long",
            "check unit_exponent: -3 means mm",
        )
    # slow to import
    from scipy.interpolate import Akima1DInterpolator, CubicSpline  # noqa: PLC0415

    dense_m = np.union1d(np.linspace(position_m[0], position_m[-1], count + 1), position_m)
    if kind == "Akima":
        return dense_m, np.asarray(Akima1DInterpolator(position_m, amplitude)(dense_m))
    return dense_m, np.asarray(CubicSpline(position_m, amplitude, bc_type="natural")(dense_m))


def _number(where: str, record: dict[str, Any], key: str, default: float) -> float:
    value = record.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e9:
        raise _refused(where, f"has {key} = {str(value)[:40]}", "give a number")
    return float(value)


def _refused(where: object, problem: str, hint: str) -> BadInputError:
    return BadInputError("bad_hjif", f"{where} {problem}", hint)
