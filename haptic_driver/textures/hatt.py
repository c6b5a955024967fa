"""Vibration from a texture model of the Penn Haptic Texture Toolkit (Culbertson, Delgado and Kuchenbecker 2014).

A file has models of the acceleration of a tool, ARMA processes, each for a speed and a force; between them their line
spectral frequencies are interpolated. The toolkit's files are for research only and not redistributable: none is here.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.files import read_text
from haptic_driver.signals import Array
from haptic_driver.textures.vibration import Vibration

LARGEST_XML_BYTES = 4 << 20
MOST_MODELS = 1000
MOST_COEFFICIENTS = 100
HIGHEST_RATE_HZ = 10e3
RATE_HZ = 1000.0  # where a file does not say
SETTLE = 2000  # samples that a process is given to forget how it began
HINT = "Give a file Models_NAME.xml of the Penn Haptic Texture Toolkit"


class Models(NamedTuple):
    """`condition` [n, 2]: speed in m/s and force in N of each model; `numbers` [n, m]: its line spectral frequencies,
    `ar` of its feedback and the rest of its excitation, then the standard deviation that drives it, gain included.
    """

    mu: float
    rate_hz: float
    condition: Array
    numbers: Array
    ar: int


def read(path: Path) -> Models:
    """The models of a file."""
    text = read_text(path, LARGEST_XML_BYTES)
    if "<!DOCTYPE" in text:  # it could unfold to any size
        raise _refused(path, "has a document type")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise _refused(path, f"is not XML: {error}") from None
    found = root.findall("model")
    if root.tag != "modelSet" or not 0 < len(found) <= MOST_MODELS:
        raise _refused(path, f"has {len(found)} models in <{root.tag[:40]}>, not 1 to {MOST_MODELS} in <modelSet>")
    models = [_model(f"{path}: model {i + 1}", model) for i, model in enumerate(found)]
    if len({(ar, len(numbers)) for _, numbers, ar in models}) > 1:
        raise _refused(path, "has models of different orders")
    rate_hz = _number(str(path), root, "SampleRate", RATE_HZ)
    if not 10.0 <= rate_hz <= HIGHEST_RATE_HZ:
        raise _refused(path, f"has a SampleRate of {rate_hz:g}")
    conditions, numbers, ar = zip(*models, strict=True)
    return Models(_number(str(path), root, "mu"), rate_hz, np.array(conditions), np.array(numbers), ar[0])


def synthesised(models: Models, speed_m_s: float, normal_force_n: float, seconds: float, seed: int) -> Vibration:
    """Acceleration of the tool in m/s^2 at a speed and a force; BadInputError where no models lie around them."""
    from scipy.interpolate import LinearNDInterpolator  # noqa: PLC0415  (slow to import)
    from scipy.signal import lfilter  # noqa: PLC0415
    from scipy.spatial import QhullError  # noqa: PLC0415

    size = models.condition.max(axis=0)
    at = np.array([speed_m_s, normal_force_n])
    try:
        numbers = LinearNDInterpolator(models.condition / size, models.numbers)(at / size)[0]
    except (QhullError, ValueError):
        numbers = np.full(models.numbers.shape[1], np.nan)
    same = np.flatnonzero(np.all(np.isclose(models.condition, at, rtol=1e-6), axis=1))
    if same.size:
        numbers = models.numbers[same[0]]
    if not np.all(np.isfinite(numbers)):
        said = f"no models lie around {speed_m_s:.4g} m/s and {normal_force_n:.4g} N"
        raise BadInputError(
            "bad_hatt", said, f"Give a --speed and --normal-force among them: {_listed(models.condition)}"
        )
    feedback, excitation = polynomial(numbers[: models.ar]), polynomial(numbers[models.ar : -1])
    count = SETTLE + round(seconds * models.rate_hz)
    noise = numbers[-1] * np.random.default_rng(seed).standard_normal(count)
    return Vibration(np.asarray(lfilter(excitation, feedback, noise))[SETTLE:], models.rate_hz)


def polynomial(lsf_rad: Array) -> Array:
    """Coefficients [p + 1] of a filter from its line spectral frequencies [p], which increase in 0 to pi.

    Itakura 1975: the filter is half the sum of a symmetric and an antisymmetric polynomial with zeros on the circle.
    """
    symmetric, antisymmetric = (
        np.poly(np.exp(1j * np.concatenate([w, -w]))).real for w in (lsf_rad[::2], lsf_rad[1::2])
    )
    if lsf_rad.size % 2:
        antisymmetric = np.convolve(antisymmetric, [1.0, 0.0, -1.0])
    else:
        symmetric, antisymmetric = np.convolve(symmetric, [1.0, 1.0]), np.convolve(antisymmetric, [1.0, -1.0])
    return 0.5 * (symmetric + antisymmetric)[:-1]


def _model(where: str, model: ElementTree.Element) -> tuple[tuple[float, float], list[float], int]:
    """Condition, numbers and order of the feedback of one model."""
    feedback, excitation = _frequencies(where, model, "ARlsf"), _frequencies(where, model, "MAlsf")
    if not feedback:
        raise _refused(where, "has no ARlsf")
    variance, gain = _number(where, model, "var"), _number(where, model, "gain", 1.0) if excitation else 1.0
    speed_mm_s, force_n = _number(where, model, "speedMod"), _number(where, model, "forceMod")
    if variance < 0.0 or speed_mm_s < 0.0 or force_n < 0.0:
        raise _refused(where, "has a var, speedMod or forceMod below 0")
    return (1e-3 * speed_mm_s, force_n), [*feedback, *excitation, abs(gain) * variance**0.5], len(feedback)


def _frequencies(where: str, model: ElementTree.Element, name: str) -> list[float]:
    values = [_as_number(where, name, value.text) for value in model.findall(f"{name}/value")]
    if not any(values):
        return []
    if len(values) > MOST_COEFFICIENTS or not np.all(np.diff([0.0, *values, np.pi]) > 0.0):
        said = f"has {len(values)} frequencies {name}, which must increase between 0 and pi"
        raise _refused(where, said)
    return values


def _number(where: str, parent: ElementTree.Element, name: str, default: float | None = None) -> float:
    text = parent.findtext(name)
    if text is None and default is not None:
        return default
    return _as_number(where, name, text)


def _as_number(where: str, name: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = np.nan
    if not abs(value) < 1e9:
        raise _refused(where, f"has {name} = {(text or 'nothing').strip()[:40]}")
    return value


def _listed(condition: Array) -> str:
    speeds, forces = (condition[:, i] for i in (0, 1))
    return f"{speeds.min():.4g} to {speeds.max():.4g} m/s, {forces.min():.3g} to {forces.max():.3g} N"


def _refused(where: object, problem: str) -> BadInputError:
    return BadInputError("bad_hatt", f"{where} {problem}", HINT)
