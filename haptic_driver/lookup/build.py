"""Model -> lookup surface, with the provenance that lets anybody build the same file again."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from math import prod

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.limits import OperatingLimits
from haptic_driver.lookup.file import CofInterval, SurfaceFile
from haptic_driver.lookup.worst_case import CORRECTION_TIMES_S, needs, worst_case
from haptic_driver.render.correction import Correction
from haptic_driver.signals import Array, Mask
from model.analysis import uncertainty
from model.conditions import Conditions, sines
from model.description import ModelDescription
from model.touch import SPEED_REFERENCE_M_S
from model.touch_model import TouchModel

MOST_POINTS = 20_000_000
VOLTAGE_HALVINGS = 20
CORRECTION_FREQUENCIES = 25
CORRECTION_SPEEDS_M_S = SPEED_REFERENCE_M_S * 25.0 ** np.linspace(-1.0, 1.0, 15)
REFERENCE = CORRECTION_SPEEDS_M_S.size // 2  # the speed at which surfaces are solved
CORRECTION_VOLTAGES = np.array([0.1, 0.3, 0.5, 0.65, 0.8, 0.9, 1.0])  # of the highest
# of friction without voltage: a smaller one is rounding, and there is nothing to correct
LEAST_RISE = 1e-9


@dataclass(frozen=True)
class SurfaceAxes:
    """Where a surface is solved: log frequency, linear voltage from 0, log normal force."""

    frequency_low_hz: float = 1.0
    frequency_high_hz: float = 1e6
    frequency_count: int = 200
    voltage_high_v: float = 150.0
    voltage_count: int = 128
    normal_force_low_n: float = 0.1
    normal_force_high_n: float = 2.0
    normal_force_count: int = 5

    def __post_init__(self) -> None:
        """Refuse axes that cannot carry a surface."""
        if not 1e-2 <= self.frequency_low_hz < self.frequency_high_hz <= 1e8:
            raise BadInputError(
                "bad_axes",
                "frequency axis is not rising within 0.01..1e8 Hz",
                "For example 1 to 1e6",
            )
        if not 0.0 < self.voltage_high_v <= 5e3:
            said = f"highest voltage {self.voltage_high_v:g} V is not in 0..5000 V"
            raise BadInputError("bad_axes", said, "For example 150")
        if not 1e-3 <= self.normal_force_low_n < self.normal_force_high_n <= 50.0:
            hint = "For example 0.1 to 2"
            raise BadInputError(
                "bad_axes", "normal force axis is not rising within 0.001..50 N", hint
            )
        counts = {name: value for name, value in vars(self).items() if name.endswith("_count")}
        for name, count in counts.items():
            if count < 4:
                raise BadInputError(
                    "bad_axes", f"{name} = {count} is too few points", "Give at least 4 per axis"
                )
        if prod(counts.values()) > MOST_POINTS:
            listed = " x ".join(f"{count} ({name})" for name, count in counts.items())
            raise BadInputError(
                "bad_axes", f"{listed} are too many points", f"Give at most {MOST_POINTS:g} in all"
            )

    @property
    def frequency_hz(self) -> Array:
        """[f], evenly spaced in the logarithm."""
        return np.geomspace(self.frequency_low_hz, self.frequency_high_hz, self.frequency_count)

    @property
    def voltage_v(self) -> Array:
        """[v], evenly spaced from 0."""
        return np.linspace(0.0, self.voltage_high_v, self.voltage_count)

    @property
    def normal_force_n(self) -> Array:
        """[n], evenly spaced in the logarithm."""
        return np.geomspace(
            self.normal_force_low_n, self.normal_force_high_n, self.normal_force_count
        )


def axes_within(description: ModelDescription, axes: SurfaceAxes | None = None) -> SurfaceAxes:
    """The part of the axes (the usual ones by default) for which a model answers: a learned effect
    has a range.
    """
    axes = axes or SurfaceAxes()
    if description.learned_form is None:
        return axes
    ranges = description.learned_form.ranges
    frequency = ranges.get("frequency_hz", (axes.frequency_low_hz, axes.frequency_high_hz))
    load = ranges.get("normal_force_n", (axes.normal_force_low_n, axes.normal_force_high_n))
    within = replace(
        axes,
        frequency_low_hz=max(axes.frequency_low_hz, frequency[0]),
        frequency_high_hz=min(axes.frequency_high_hz, frequency[1]),
        voltage_high_v=min(
            axes.voltage_high_v, ranges.get("voltage_v", (0.0, axes.voltage_high_v))[1]
        ),
        normal_force_low_n=max(axes.normal_force_low_n, load[0]),
        normal_force_high_n=min(axes.normal_force_high_n, load[1]),
    )
    known_v, unknown_v = 0.0, within.voltage_high_v
    if not _outside(description, within):
        return within
    # an effect of the drive makes more of the voltage before the learned one sees it
    for _ in range(VOLTAGE_HALVINGS):
        middle_v = 0.5 * (known_v + unknown_v)
        if _outside(description, replace(within, voltage_high_v=middle_v)):
            unknown_v = middle_v
        else:
            known_v = middle_v
    return replace(within, voltage_high_v=known_v)


def _outside(description: ModelDescription, axes: SurfaceAxes) -> str:
    """What of the axes a learned effect does not know, in words; empty where it knows all."""
    f, v, n = axes.frequency_hz, axes.voltage_v, axes.normal_force_n
    return description.outside(sines(f[:, None, None], v[:, None], n, SPEED_REFERENCE_M_S, 0.0))


def build_surface(
    description: ModelDescription,
    limits: OperatingLimits,
    axes: SurfaceAxes | None = None,
    with_interval: bool = False,
) -> SurfaceFile:
    """Solve the model on every point of the axes; `with_interval` adds how far friction may be off.

    `limits` only mark `within_limits`, the rig applies its own. It takes a quarter of a second of
    one core, or half a second with the slowest effects. An interval doubles that
    (`benchmarks/surface_build.py`). A new roughness shape needs a gap table first, once, which
    takes a second. Without `axes` the usual ones, as far as the model goes; BadInputError where
    those given reach beyond what a learned effect was learned from.
    """
    axes = axes or axes_within(description)
    f, v, n = axes.frequency_hz, axes.voltage_v, axes.normal_force_n
    if outside := _outside(description, axes):
        hint = (
            "Build within its range, measure there and diagnose again, or remove [effects.learned]"
        )
        raise BadInputError(
            "outside_range", f"model '{description.name}' has learned nothing at {outside}", hint
        )
    touch = TouchModel(description)
    stuck_a_per_v, density, electrode_gain = worst_case(description, f, v)
    if not (np.isfinite(density).all() and np.isfinite(electrode_gain).all()):
        said = (
            f"model '{description.name}' gives no finite current or voltage somewhere on these axes"
        )
        raise BadInputError("not_finite", said, "look at its effects, a learned one first")
    solved = touch.surface(f, v, n)
    interval = None
    if with_interval and not description.is_published:
        interval = CofInterval(*uncertainty.cof_interval(description, f, v, n, solved.cof))
    return SurfaceFile(
        frequency_hz=f,
        voltage_v=v,
        normal_force_n=n,
        cof=solved.cof,
        electrostatic_force_n=solved.electrostatic_force_n,
        current_rms_a=solved.current_rms_a,
        stuck_current_a_per_v=stuck_a_per_v,
        stuck_density_a_per_v_m2=density,
        electrode_gain=electrode_gain,
        slew_v_per_s=2.0 * np.pi * f[:, None] * v,
        pulled_in=solved.pulled_in | _pulled_in_at_other_speeds(touch, f, v, n),
        within_theory=solved.within_theory,
        within_limits=limits.permits(
            f[:, None, None],
            v[:, None],
            solved.current_rms_a,
            (v * limits.stuck_current(stuck_a_per_v, density))[:, :, None],
            (v * electrode_gain)[:, :, None],
        ),
        provenance={
            "model": description.provenance(),
            "model_hash": description.content_hash,
            "gap_table_hash": touch.table.content_hash,
            "limits": (
                asdict(limits)
                | {"contact_current_a_rms": [list(point) for point in limits.contact_current_a_rms]}
            ),
            "waveform": "sine",
            **({} if interval is None else {"uncertainty": uncertainty.provenance(description)}),
            **_programs(),
            "built_at": datetime.now(UTC).isoformat(timespec="seconds"),
        },
        correction=_correction(touch, axes),
        cof_interval=interval,
    )


def _pulled_in_at_other_speeds(touch: TouchModel, f: Array, v: Array, n: Array) -> Mask | bool:
    """Where the contact pulls in at a speed at which a finger may be, though not at the usual
    one.
    """
    if not needs(touch.description, "speed_m_s"):
        return False
    found = [
        touch.pulled_in_at(f, v, n, speed) for speed in CORRECTION_SPEEDS_M_S[[0, -1]].tolist()
    ]
    return np.asarray(found[0] | found[1])


def is_of(surface: SurfaceFile, description: ModelDescription) -> bool:
    """Whether a surface was solved from just this model, the words about it included."""
    about = surface.provenance
    return (
        about.get("model_hash") == description.content_hash
        and about["model"] == description.provenance()
    )


@cache
def _programs() -> dict[str, str]:
    names = ("haptic-driver", "numpy", "scipy")
    return {
        "program": f"haptic-driver {version(names[0])}",
        **{name: version(name) for name in names[1:]},
    }


def _correction(touch: TouchModel, axes: SurfaceAxes) -> Correction | None:
    """What speed and time do to friction by this model; None where it has no effect of either."""
    if not any(effect.needs for effect in touch.description.effects):
        return None
    f = np.geomspace(axes.frequency_low_hz, axes.frequency_high_hz, CORRECTION_FREQUENCIES)
    n = axes.normal_force_n
    voltage = np.concatenate([[0.0], CORRECTION_VOLTAGES * axes.voltage_high_v])

    speeds = (
        CORRECTION_SPEEDS_M_S
        if needs(touch.description, "speed_m_s")
        else np.array([SPEED_REFERENCE_M_S])
    )
    cof = touch.cof_at_speeds(f, voltage, n, speeds).transpose(0, 3, 1, 2)  # [f, n, s, v]
    cof = np.broadcast_to(cof, (f.size, n.size, CORRECTION_SPEEDS_M_S.size, voltage.size))
    off, rise = cof[0, :, :, 0], cof[:, :, :, 1:] - cof[:, :, :, :1]
    usual = rise[:, :, [REFERENCE]]
    no_rise = usual <= LEAST_RISE * cof[:, :, [REFERENCE], :1]
    zero = np.zeros_like(CORRECTION_TIMES_S)
    over_time = touch.predict(Conditions(zero, zero, zero + n[0], time_s=CORRECTION_TIMES_S)).cof
    return Correction(
        log_frequency=np.log(f),
        log_normal_force=np.log(n),
        log_speed=np.log(CORRECTION_SPEEDS_M_S),
        voltage_v=voltage[1:],
        time_s=CORRECTION_TIMES_S,
        off_factor=off / off[:, [REFERENCE]],
        gain_factor=np.where(no_rise, 1.0, rise / np.where(no_rise, 1.0, usual)),
        time_factor=over_time / off[0, REFERENCE],
    )
