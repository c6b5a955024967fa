"""Processes of a texture model of the Penn Haptic Texture Toolkit (Culbertson, Delgado and
Kuchenbecker 2014).

A file has models of the acceleration of a tool, ARMA processes, each for a speed and a force. The
toolkit's files are for research only and not redistributable: none is here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.lab.importers import NOT_MEASURED, Asked, Made, needs_scale
from haptic_driver.signals import Array
from haptic_driver.textures import description
from haptic_driver.textures.bands import EDGES_HZ
from haptic_driver.textures.process import power
from haptic_driver.textures.spectrum import spectrum
from model.support.cells import number
from model.support.reading import read_text

LARGEST_XML_BYTES = 4 << 20
MOST_MODELS = 150  # so many fit a texture's file
MOST_COEFFICIENTS = 100
LOWEST_RATE_HZ, HIGHEST_RATE_HZ = 100.0, 10e3
RATE_HZ = 1000.0  # where a file does not say
HINT = "Give a file Models_NAME.xml of the Penn Haptic Texture Toolkit"


class Process(NamedTuple):
    """One model: noise of `variance`, in (m/s^2)^2, through a filter of coefficients `ar`, `ma`,
    without leading 1.
    """

    speed_mm_s: float
    normal_force_n: float
    variance: float
    ar: Array
    ma: Array


class Models(NamedTuple):
    """All of a file, with the friction it says."""

    mu: float
    rate_hz: float
    processes: list[Process]

    def described(self, cof_rms: float) -> list[dict[str, Any]]:
        """Tables `process` of a texture's file; the model that vibrates most in the nine bands has
        this friction.
        """
        frequency_hz = np.arange(EDGES_HZ[0], EDGES_HZ[-1], 0.1)
        powers = [
            one.variance * power(frequency_hz, self.rate_hz, one.ar, one.ma).sum()
            for one in self.processes
        ]
        shares = np.sqrt(powers / np.max(powers)).tolist()
        return [
            {
                "speed_mm_s": one.speed_mm_s,
                "normal_force_n": one.normal_force_n,
                "cof_rms": cof_rms * share,
            }
            | {name: side.tolist() for name, side in (("ar", one.ar), ("ma", one.ma)) if side.size}
            for one, share in zip(self.processes, shares, strict=True)
        ]


def made(source: Path, asked: Asked) -> Made:
    """See `importers`; all models of a file as processes."""
    if asked.cof_rms is None:
        said = f"{source} holds vibrations: it does not say how much friction they are"
        raise needs_scale(said, "--cof-rms 0.02")
    models = read(source)
    head = {
        "kind": "spectrum",
        "description": NOT_MEASURED,
        "mean_cof": models.mu if asked.mean_cof is None else asked.mean_cof,
        "rate_hz": models.rate_hz,
        "perceptual_gain": asked.perceptual_gain,
    }
    tables = models.described(asked.cof_rms)
    described = description.parse(head | {"process": tables}, source)
    assert isinstance(described, description.SpectrumDescription)
    low, high = spectrum(described, str(source)).bounds()
    speeds_m_s = sorted(1e-3 * one.speed_mm_s for one in models.processes)
    loads_n = sorted(one.normal_force_n for one in models.processes)
    found = {
        "processes": len(tables),
        "speed_m_s": [speeds_m_s[0], speeds_m_s[-1]],
        "normal_force_n": [loads_n[0], loads_n[-1]],
        "cof": [low, high],
        "perceptual_gain": asked.perceptual_gain,
    }
    shown = [
        f"{len(tables)} processes for {speeds_m_s[0]:.3g} to {speeds_m_s[-1]:.3g} m/s"
        f" and {loads_n[0]:.3g} to {loads_n[-1]:.3g} N",
        f"friction {low:.4g} to {high:.4g}",
        NOT_MEASURED,
    ]
    return Made(head, found, shown, processes=tables)


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
        raise _refused(
            path,
            f"has {len(found)} models in <{root.tag[:40]}>, not 1 to {MOST_MODELS} in <modelSet>",
        )
    models = [_model(f"{path}: model {i + 1}", model) for i, model in enumerate(found)]
    if len({(one.ar.size, one.ma.size) for one in models}) > 1:
        raise _refused(path, "has models of different orders")
    if not max(one.variance for one in models) > 0.0:
        raise _refused(path, "has no model that vibrates")
    rate_hz = _number(str(path), root, "SampleRate", RATE_HZ)
    if not LOWEST_RATE_HZ <= rate_hz <= HIGHEST_RATE_HZ:
        raise _refused(path, f"has a SampleRate of {rate_hz:g}")
    return Models(_number(str(path), root, "mu"), rate_hz, models)


def polynomial(lsf_rad: Array) -> Array:
    """Coefficients [p] of a filter from its line spectral frequencies [p], which increase in 0 to
    pi; no leading 1.

    Itakura 1975: the filter is half the sum of a symmetric and an antisymmetric polynomial with
    zeros on the circle.
    """
    symmetric, antisymmetric = (
        np.poly(np.exp(1j * np.concatenate([w, -w]))).real for w in (lsf_rad[::2], lsf_rad[1::2])
    )
    if lsf_rad.size % 2:
        antisymmetric = np.convolve(antisymmetric, [1.0, 0.0, -1.0])
    else:
        symmetric, antisymmetric = (
            np.convolve(symmetric, [1.0, 1.0]),
            np.convolve(antisymmetric, [1.0, -1.0]),
        )
    return 0.5 * (symmetric + antisymmetric)[1:-1]


def _model(where: str, model: ElementTree.Element) -> Process:
    feedback, excitation = _frequencies(where, model, "ARlsf"), _frequencies(where, model, "MAlsf")
    if not feedback.size:
        raise _refused(where, "has no ARlsf")
    variance, gain = (
        _number(where, model, "var"),
        _number(where, model, "gain", 1.0) if excitation.size else 1.0,
    )
    speed_mm_s, force_n = _number(where, model, "speedMod"), _number(where, model, "forceMod")
    if variance < 0.0 or speed_mm_s < 0.0 or force_n < 0.0:
        raise _refused(where, "has a var, speedMod or forceMod below 0")
    return Process(
        speed_mm_s, force_n, gain**2 * variance, polynomial(feedback), polynomial(excitation)
    )


def _frequencies(where: str, model: ElementTree.Element, name: str) -> Array:
    values = [_as_number(where, name, value.text) for value in model.findall(f"{name}/value")]
    if not any(values):
        return np.empty(0)
    if len(values) > MOST_COEFFICIENTS or not np.all(np.diff([0.0, *values, np.pi]) > 0.0):
        said = f"has {len(values)} frequencies {name}, which must increase between 0 and pi"
        raise _refused(where, said)
    return np.array(values)


def _number(
    where: str, parent: ElementTree.Element, name: str, default: float | None = None
) -> float:
    text = parent.findtext(name)
    if text is None and default is not None:
        return default
    return _as_number(where, name, text)


def _as_number(where: str, name: str, text: str | None) -> float:
    try:
        value = number(text or "")
    except ValueError:
        value = np.nan
    if not abs(value) < 1e9:
        raise _refused(where, f"has {name} = {(text or 'nothing').strip()[:40]}")
    return value


def _refused(where: object, problem: str) -> BadInputError:
    return BadInputError("bad_hatt", f"{where} {problem}", HINT)
