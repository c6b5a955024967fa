"""The lookup surface as a file: HDF5, readable from MATLAB, with full provenance and a content
hash.

Datasets: `frequency_hz` [f], `voltage_v` [v], `normal_force_n` [n]. [f, v, n] are `cof`,
`electrostatic_force_n`, `current_rms_a` and the masks `pulled_in`, `within_theory`,
`within_limits`. `slew_v_per_s` is [f, v].

Per volt that is set there are `stuck_current_a_per_v` (A rms) of one touch,
`stuck_density_a_per_v_m2` and `electrode_gain` [f, v]. All are for the worst load and time. A
reader works these out anew from the model in the provenance. Where speed or time matter, the fields
of `render/correction.py` follow as `correction_*`. Where the model's
uncertainty was carried along, friction lies between `cof_low` and `cof_high` [f, v, n] with 68 %
probability. Attributes are strings and floats only (MATLAB's h5readatt fails on integers).
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass, fields, replace
from functools import cached_property
from math import log
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import BadInputError
from haptic_driver.files import replacing
from haptic_driver.limits import OperatingLimits, WorstCase
from haptic_driver.lookup import labelled
from haptic_driver.lookup.worst_case import worst_case
from haptic_driver.render.correction import Correction
from haptic_driver.render.surface import Surface
from haptic_driver.signals import Array, Mask
from model.conditions import Conditions
from model.description import ModelDescription
from model.support.interpolation import linear_weights, polynomial_weights
from model.touch_model import TouchModel

FORMAT = "haptic-driver surface"
FORMAT_VERSION = 3.0  # those before know the worst case of one touch alone, or of none
# before the names of a correction's datasets, and of an interval's
CORRECTION, COF = "correction_", "cof_"
SAME = 1e-6  # between two machines
# kept clear of a limit, so that its own check by another path never fails by rounding
ROUNDING = 1e-9
FORCE_REFINEMENT = 4  # cells of the look-up per cell of the file along normal force
FORCE_LEVELS = 5  # nearest, that a polynomial between them goes through
# where a model is asked whether its friction depends on pressure alone, and how nearly
SEEN_HZ, SEEN_V, SEEN_N, SAME_COF = (60.0, 1e4), (0.0, 60.0), 0.5, 5e-3


class CofInterval(NamedTuple):
    """Friction [f, v, n] at the ends of a 68 % interval; infinite where the contact may have pulled
    in.
    """

    low: Array
    high: Array


@dataclass(frozen=True)
class SurfaceFile:
    """Everything a surface file holds; see the module for shapes. `provenance` is what a reader
    needs to redo it.
    """

    frequency_hz: Array
    voltage_v: Array
    normal_force_n: Array
    cof: Array
    electrostatic_force_n: Array
    current_rms_a: Array
    stuck_current_a_per_v: Array
    stuck_density_a_per_v_m2: Array
    electrode_gain: Array
    slew_v_per_s: Array
    pulled_in: Mask
    within_theory: Mask
    within_limits: Mask
    provenance: dict[str, Any]
    correction: Correction | None = None
    cof_interval: CofInterval | None = None

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 over every number and the model's description: equal files, equal surfaces.

        It is worked out once, since it takes milliseconds and every status of the daemon has it.
        """
        digest = hashlib.sha256()
        for name, values in self._datasets().items():
            digest.update(name.encode())
            digest.update(str(values.shape).encode())
            digest.update(np.ascontiguousarray(values).tobytes())
        digest.update(json.dumps(self.provenance["model"], sort_keys=True).encode())
        return digest.hexdigest()

    def to_xarray(self) -> Any:
        """An xarray Dataset over frequency, voltage and load, masks too; HapticError where xarray
        is not installed.
        """
        ends = {} if self.cof_interval is None else self.cof_interval._asdict()
        values = {name: getattr(self, name) for name in _REQUIRED if name not in _AXES}
        values |= {f"{COF}{name}": end for name, end in ends.items()}
        about = {"content_hash": self.content_hash, "model": self.provenance["model"]["name"]}
        return labelled.dataset({name: getattr(self, name) for name in _AXES}, values, about)

    def to_frame(self) -> Any:
        """A pandas DataFrame, one row per point of the grid; HapticError where pandas or xarray is
        not installed.
        """
        return self.to_xarray().to_dataframe().reset_index()

    def section(self, normal_force_n: float) -> tuple[Array, Mask]:
        """Friction [f, v] under one load of the surface's range, and what the limits allow on both
        sides of it.
        """
        nodes = self.normal_force_n
        above = int(np.clip(np.searchsorted(nodes, normal_force_n), 1, nodes.size - 1))
        cof = _cof_under(self, np.array([normal_force_n]))
        allowed = self.within_limits[:, :, above - 1] & self.within_limits[:, :, above]
        return cof[:, :, 0], allowed

    @property
    def stuck_current_rms_a(self) -> Array:
        """Into a stuck or wet finger [f, v], A rms."""
        return self.voltage_v * self.stuck_current_a_per_v

    def worst_case(self, limits: OperatingLimits) -> WorstCase:
        """What electrode, and all contact that `limits` hold for, get at most."""
        stuck = limits.stuck_current(self.stuck_current_a_per_v, self.stuck_density_a_per_v_m2)
        return WorstCase.of(self.frequency_hz, self.voltage_v, stuck, self.electrode_gain)

    @property
    def _worst(self) -> tuple[Array, Array, Array]:
        """What `lookup.worst_case` has worked out."""
        return self.stuck_current_a_per_v, self.stuck_density_a_per_v_m2, self.electrode_gain

    def protected_by(self, signed: SurfaceFile) -> SurfaceFile:
        """The same with the larger worst case of both, so that no point is allowed which either
        forbids.
        """
        worst = signed._worst
        axes = ((self.frequency_hz, signed.frequency_hz), (self.voltage_v, signed.voltage_v))
        if not all(np.array_equal(own, other) for own, other in axes):
            model = ModelDescription.of(signed.provenance["model"])
            worst = worst_case(model, self.frequency_hz, self.voltage_v)
        stuck, density, gain = map(np.maximum, self._worst, worst)
        return replace(
            self, stuck_current_a_per_v=stuck, stuck_density_a_per_v_m2=density, electrode_gain=gain
        )

    def _datasets(self) -> dict[str, NDArray[Any]]:
        own = {name: getattr(self, name) for name in _REQUIRED}
        more = {} if self.correction is None else self.correction._asdict()
        ends = {} if self.cof_interval is None else self.cof_interval._asdict()
        return (
            own
            | {f"{CORRECTION}{name}": x for name, x in more.items()}
            | {f"{COF}{k}": x for k, x in ends.items()}
        )

    def write(self, path: Path) -> None:
        """Write all or nothing; HapticError says why not."""
        import h5py  # noqa: PLC0415  (slow to import, and not for every surface)

        with replacing(path) as part, h5py.File(part, "w") as file:
            file.attrs["format"] = FORMAT
            file.attrs["format_version"] = FORMAT_VERSION
            file.attrs["content_hash"] = self.content_hash
            file.attrs["provenance"] = json.dumps(self.provenance)
            for name, values in self._datasets().items():
                file.create_dataset(
                    name, data=values.astype(np.uint8) if values.dtype == bool else values
                )


_AXES = ("frequency_hz", "voltage_v", "normal_force_n")
_REQUIRED = [
    f.name
    for f in fields(SurfaceFile)
    if f.name not in ("provenance", "correction", "cof_interval")
]


def read_surface(path: Path) -> SurfaceFile:
    """Read and verify a surface file; BadInputError for a missing, damaged, foreign or newer
    one.
    """
    import h5py  # noqa: PLC0415

    rebuild = "Build a new one with: haptic surface build --out surface.h5"
    if not os.path.isfile(path):
        said = (
            "is a folder, not a surface file"
            if os.path.isdir(path)
            else "there is no such surface file"
        )
        raise BadInputError("surface_not_found", f"{path}: {said}", rebuild)
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != FORMAT:
                raise BadInputError(
                    "surface_foreign", f"{path}: is HDF5 but not a haptic-driver surface", rebuild
                )
            version = float(file.attrs["format_version"])
            if version != FORMAT_VERSION:
                raise BadInputError(
                    "surface_version",
                    f"{path}: has format {version:g}, this program reads {FORMAT_VERSION:g}",
                    rebuild,
                )
            arrays = {name: file[name][...] for name in _REQUIRED}
            corrected = f"{CORRECTION}off_factor" in file
            more = (
                {name: file[f"{CORRECTION}{name}"][...] for name in Correction._fields}
                if corrected
                else {}
            )
            bounded = f"{COF}low" in file
            ends = (
                {name: file[f"{COF}{name}"][...] for name in CofInterval._fields} if bounded else {}
            )
            provenance = json.loads(file.attrs["provenance"])
            stored_hash = str(file.attrs["content_hash"])
        masks = ("pulled_in", "within_theory", "within_limits")
        surface = SurfaceFile(
            **{
                n: a.astype(bool) if n in masks else a.astype(np.float64) for n, a in arrays.items()
            },
            provenance=provenance,
            correction=Correction(**more) if corrected else None,
            cof_interval=CofInterval(**ends) if bounded else None,
        )
        intact = surface.content_hash == stored_hash
    except (OSError, KeyError, TypeError, ValueError, RuntimeError) as error:
        raise BadInputError(
            "surface_corrupt", f"{path}: not a readable surface file ({error})", rebuild
        ) from error
    if not intact:
        raise BadInputError(
            "surface_corrupt",
            f"{path}: its content does not match its hash; the file is damaged",
            rebuild,
        )
    try:
        model = ModelDescription.of(surface.provenance["model"])
        worst = worst_case(model, surface.frequency_hz, surface.voltage_v)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        said = (
            f"it names no model by which its limits could be checked ({type(error).__name__}:"
            f" {error})"
        )
        raise BadInputError("surface_corrupt", f"{path}: {said}", rebuild) from error
    if not np.allclose(worst, surface._worst, rtol=SAME, atol=0.0):
        said = (
            "its worst case is not that of the model which it names, and limits are judged by that"
        )
        raise BadInputError("surface_corrupt", f"{path}: {said}", rebuild)
    return surface


def cof_interval_at(
    file: SurfaceFile, frequency_hz: float, voltage_v: float, normal_force_n: float
) -> tuple[float, float] | None:
    """The interval of friction at one point of the surface; None where the file carries none."""
    if file.cof_interval is None:
        return None
    nodes = (np.log(file.frequency_hz), file.voltage_v, np.log(file.normal_force_n))
    point = log(frequency_hz), voltage_v, log(normal_force_n)
    weights = [linear_weights(axis, np.asarray(x)) for axis, x in zip(nodes, point, strict=True)]
    around = np.ix_(*(np.flatnonzero(w) for w in weights))  # further away it may be infinite
    share = np.einsum("f,v,n->fvn", *(w[w > 0.0] for w in weights))
    low, high = (float(np.sum(share * end[around])) for end in file.cof_interval)
    return low, high


def ready_for_lookup(file: SurfaceFile, limits: OperatingLimits) -> Surface:
    """The surface as the controller reads it: finer along normal force, the rig's limits applied.

    A forbidden point ends the voltage range of its row, so nothing beyond the first of them is ever
    offered.
    """
    nodes = file.normal_force_n
    force = np.geomspace(nodes[0], nodes[-1], (nodes.size - 1) * FORCE_REFINEMENT + 1)
    known = _cof_under(file, force)
    if not np.isfinite(known).any():
        said = (
            f"by model '{file.provenance['model']['name']}' the finger sticks to the screen without"
            " any voltage"
        )
        raise BadInputError("no_equilibrium", said, "look at its effects: the contact pulls in")
    current = _refined(file.current_rms_a, file, force)
    cof = np.where(np.isfinite(known), known, np.nanmax(known))

    above = np.minimum(np.searchsorted(nodes, force), nodes.size - 1)
    below = np.maximum(above - 1, 0)
    sound = file.within_theory & ~file.pulled_in
    sound = sound[:, :, above] & sound[:, :, below] & np.isfinite(known) & np.isfinite(current)
    sound &= (
        np.nan_to_num(current)
        <= limits.contact_current_limit_a_rms(file.frequency_hz)[:, None, None]
    )
    last_sound = np.where(sound.all(axis=1), sound.shape[1], np.argmin(sound, axis=1)) - 1
    worst = file.worst_case(limits)
    allowed_v = limits.highest_within_v(worst) * (1.0 - ROUNDING)
    limit_v = np.minimum(allowed_v[:, None], file.voltage_v[np.maximum(last_sound, 0)])
    return Surface(
        log_frequency=np.log(file.frequency_hz),
        log_normal_force=np.log(force),
        voltage_v=file.voltage_v,
        cof=np.ascontiguousarray(cof.transpose(0, 2, 1)),
        current_rms_a=np.ascontiguousarray(np.nan_to_num(current).transpose(0, 2, 1)),
        stuck_current_a_per_v=worst.stuck_current_a_per_v,
        electrode_gain=worst.electrode_gain,
        voltage_limit_v=np.ascontiguousarray(limit_v),
        log_pressure=np.empty(0),
    )


def with_areas(surface: Surface, model: TouchModel) -> Surface:
    """The surface of `model`, ready for touches whose area is known.

    It is the surface itself where the model's friction depends on more than pressure, or where
    pressure does not rise with load.
    """
    loads_n = np.exp(surface.log_normal_force)
    areas_m2 = np.array([model.contact_area_m2(float(load_n)) for load_n in loads_n])
    log_pressure = np.log(loads_n / areas_m2)
    known = by_pressure(model) and bool((np.diff(log_pressure) > 0.0).all())
    return surface._replace(log_pressure=log_pressure) if known else surface


def by_pressure(model: TouchModel) -> bool:
    """Whether half of a touch under half of its load has the friction of the whole, by the model.

    Where currents meet a resistance outside the touch, or friction knows the load, it has not.
    """
    frequency_hz, voltage_v = (x.ravel() for x in np.meshgrid(SEEN_HZ, SEEN_V))
    whole_n = np.full(voltage_v.size, SEEN_N)
    area_m2 = np.full(voltage_v.size, model.contact_area_m2(SEEN_N))
    whole, half = (
        model.cof(
            Conditions(frequency_hz, voltage_v, share * whole_n, contact_area_m2=share * area_m2)
        )
        for share in (1.0, 0.5)
    )
    return bool(np.allclose(half, whole, rtol=SAME_COF, atol=0.0))


def _cof_under(file: SurfaceFile, force: Array) -> Array:
    """Friction [f, v, n] under other loads.

    What is refined is friction without voltage, and its rise times F_n/V^2, which is smooth where
    friction is not.
    """
    nodes = file.normal_force_n
    off = file.cof[:, :1]
    rise = _refined((file.cof - off) * nodes, file, force) / force
    weights = polynomial_weights(np.log(nodes), np.log(force), FORCE_LEVELS)
    return np.asarray(rise + np.exp(np.log(off) @ weights.T))


def _refined(values: Array, file: SurfaceFile, force: Array) -> Array:
    """`values` [f, v, n] on the finer normal forces: polynomials of log(values) over log force; 0
    at V = 0.
    """
    # where voltage does nothing, or less than that
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = np.log(values[:, 1:])
    known = np.asarray(np.isfinite(scaled).all(axis=2))
    weights = polynomial_weights(np.log(file.normal_force_n), np.log(force), FORCE_LEVELS)
    fine = np.zeros((*values.shape[:2], force.size))
    np.exp(np.where(known[:, :, None], scaled, 0.0) @ weights.T, out=fine[:, 1:])
    fine[:, 1:][~known] = np.nan
    return fine
