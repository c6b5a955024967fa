"""Calibration files of ATI force/torque transducers read by an analog input card.

Newer files hold `UserAxis` elements, the matrix as it is. Older ones hold only `Axis` elements, to
be divided by their `scale` and moved from the calibration point by `BasicTransform`. Both forms are
described in the comment that heads the newer files.
"""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from hw.errors import DeviceError

Array = NDArray[np.float64]

AXES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
GAUGES = 6
SATURATION_SHARE = 0.99  # of the gauges' range; beyond it a sample counts as saturated

_POUND_N, _KILOPOND_N, _INCH_M, _FOOT_M = 4.4482216152605, 9.80665, 0.0254, 0.3048  # by definition
NEWTONS = {
    "n": 1.0,
    "kn": 1e3,
    "lbf": _POUND_N,
    "lb": _POUND_N,
    "klbf": 1e3 * _POUND_N,
    "kgf": _KILOPOND_N,
}
METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": _INCH_M, "ft": _FOOT_M}
NEWTON_METRES = {
    "n-m": 1.0,
    "nm": 1.0,
    "n-mm": 1e-3,
    "nmm": 1e-3,
    "kn-m": 1e3,
    "lbf-in": _POUND_N * _INCH_M,
    "lbf-ft": _POUND_N * _FOOT_M,
    "kgf-cm": _KILOPOND_N * 1e-2,
}


class BadCalibration(DeviceError):  # noqa: N818 - named as its siblings in hw.errors
    """The calibration file is not what the sensor needs."""

    code = "bad_calibration"


@dataclass(frozen=True, eq=False)
class AtiCalibration:
    """Gauge voltages -> force and torque.

    `matrix` is 6 x 6, rows Fx..Tz, columns gauges 0..5, N/V and N m/V. `full_scale` is the
    calibrated end of each axis, N and N m. The gauges end at +-`gauge_range_v`.
    """

    serial: str
    part_number: str
    calibrated_on: str
    matrix: Array
    full_scale: Array
    gauge_range_v: float

    @classmethod
    def from_file(cls, path: Path) -> AtiCalibration:
        """Read a calibration file (.cal). Raises BadCalibration."""
        try:
            return cls.from_xml(path.read_bytes(), str(path))
        except OSError as error:
            raise BadCalibration(
                f"{path} cannot be read ({error})", "give the .cal file of this transducer"
            ) from error

    @classmethod
    def from_xml(cls, xml: bytes, where: str) -> AtiCalibration:
        """Parse the content of a calibration file; `where` names it in errors. Raises
        BadCalibration.
        """
        return _parse(xml, where)

    def wrench(self, gauges_v: Array, bias_v: Array) -> Array:
        """Fx..Tz in N and N m: the matrix times the gauges less their unloaded mean."""
        return np.asarray(self.matrix @ (gauges_v - bias_v), dtype=np.float64)

    def saturated(self, gauges_v: Array) -> bool:
        """Whether any sample of any gauge is at the end of its range, or not a number."""
        return not bool(np.all(np.abs(gauges_v) < SATURATION_SHARE * self.gauge_range_v))

    def overloaded(self, wrench: Array) -> bool:
        """Whether any axis is beyond what was calibrated, or not a number."""
        return not bool(np.all(np.abs(wrench) <= self.full_scale))


def unit(name: str, known: dict[str, float], where: str) -> float:
    """SI units in one `name`, without regard to case; raises BadCalibration with the nearest known
    name.
    """
    factor = known.get(name.strip().lower())
    if factor is None:
        near = difflib.get_close_matches(name.lower(), known, n=1)
        hint = f"did you mean {near[0]}? " if near else ""
        raise BadCalibration(
            f"{where}: unknown unit {name!r}", f"{hint}known are {', '.join(known)}"
        )
    return factor


def _parse(xml: bytes, where: str) -> AtiCalibration:
    sensor = _root(xml, where)
    calibration = sensor.find("Calibration")
    if calibration is None:
        raise BadCalibration(
            f"{where}: <FTSensor> holds no <Calibration>", "give the complete .cal file"
        )
    _check_system(sensor, calibration, where)
    to_si = np.repeat(
        [
            unit(_attribute(calibration, "ForceUnits", where), NEWTONS, where),
            unit(_attribute(calibration, "TorqueUnits", where), NEWTON_METRES, where),
        ],
        3,
    )
    if calibration.find("UserAxis") is not None:
        axes = _axes(calibration, "UserAxis", where)
        matrix = to_si[:, None] * _rows(axes, where)
    else:
        axes = _axes(calibration, "Axis", where)
        scale = np.array([_number(axis, "scale", where) for axis in axes])
        if np.any(scale == 0.0):
            raise BadCalibration(
                f"{where}: an <Axis> has scale 0", "give the file as ATI delivered it"
            )
        matrix = _moved(
            to_si[:, None] * _rows(axes, where) / scale[:, None],
            _displacement_m(calibration, where),
        )
    full_scale = to_si * np.array([_number(axis, "max", where) for axis in axes])
    if not np.all(full_scale > 0.0):
        raise BadCalibration(
            f"{where}: every axis needs max > 0", "give the file as ATI delivered it"
        )
    return AtiCalibration(
        serial=sensor.get("Serial", "unknown"),
        part_number=calibration.get("PartNumber", "unknown"),
        calibrated_on=calibration.get("CalDate", "unknown"),
        matrix=matrix,
        full_scale=full_scale,
        gauge_range_v=0.5 * _number(calibration, "OutputRange", where),
    )


def _root(xml: bytes, where: str) -> ElementTree.Element:
    try:
        root = ElementTree.fromstring(xml)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise BadCalibration(
            f"{where} is not XML ({error})", "give the .cal file of this transducer"
        ) from error
    if root.tag != "FTSensor":
        raise BadCalibration(
            f"{where} is not an ATI calibration: its root is <{root.tag}>, not <FTSensor>",
            "give the .cal file of this transducer",
        )
    return root


def _check_system(
    sensor: ElementTree.Element, calibration: ElementTree.Element, where: str
) -> None:
    """Refuse what this file's meaning is not known for."""
    for element, name, needed in (
        (sensor, "Family", "DAQ"),
        (sensor, "NumGages", str(GAUGES)),
        (calibration, "OutputBipolar", "True"),
        (calibration, "GainMultiplier", "1"),
    ):
        value = element.get(name, needed)
        if value.strip().lower() != needed.lower():
            raise BadCalibration(
                f"{where}: {name} is {value!r}; only {needed!r} is supported",
                "give the calibration of a six-gauge transducer on an analog input card",
            )
    if not _number(calibration, "OutputRange", where) > 0.0:
        raise BadCalibration(
            f"{where}: OutputRange must be > 0", "give the file as ATI delivered it"
        )


def _axes(calibration: ElementTree.Element, tag: str, where: str) -> list[ElementTree.Element]:
    found = {axis.get("Name", ""): axis for axis in calibration.findall(tag)}
    missing = [name for name in AXES if name not in found]
    if missing or len(calibration.findall(tag)) != len(AXES):
        raise BadCalibration(
            f"{where}: needs one <{tag}> for each of {', '.join(AXES)}; missing:"
            f" {', '.join(missing) or 'none'}",
            "give the complete .cal file of a six-axis transducer",
        )
    return [found[name] for name in AXES]


def _rows(axes: list[ElementTree.Element], where: str) -> Array:
    return np.array([_row(axis, where) for axis in axes])


def _row(axis: ElementTree.Element, where: str) -> list[float]:
    texts = _attribute(axis, "values", where).split()
    if len(texts) != GAUGES:
        raise BadCalibration(
            f"{where}: axis {axis.get('Name')} has {len(texts)} values, not {GAUGES}",
            "give the file as ATI delivered it",
        )
    return [_finite(text, f"{where}: axis {axis.get('Name')}") for text in texts]


def _displacement_m(calibration: ElementTree.Element, where: str) -> Array:
    transform = calibration.find("BasicTransform")
    if transform is None:
        raise BadCalibration(
            f"{where} has neither <UserAxis> nor <BasicTransform>: where its torques are taken is"
            " unknown",
            "ask ATI for a file with <UserAxis>",
        )
    if any(_number(transform, name, where, "0") != 0.0 for name in ("Rx", "Ry", "Rz")):
        raise BadCalibration(
            f"{where}: a rotated <BasicTransform> is not supported",
            "ask ATI for one with <UserAxis>",
        )
    metres = unit(_attribute(calibration, "DistUnits", where), METRES, where)
    return metres * np.array([_number(transform, name, where, "0") for name in ("Dx", "Dy", "Dz")])


def _moved(matrix: Array, displacement_m: Array) -> Array:
    """Torques taken about a point displaced by D: T - D x F; for D along z, Tx += Dz Fy and Ty -=
    Dz Fx.
    """
    moved = matrix.copy()
    moved[3:] -= np.cross(displacement_m, matrix[:3], axisb=0, axisc=0)
    return moved


def _attribute(element: ElementTree.Element, name: str, where: str) -> str:
    value = element.get(name)
    if value is None:
        raise BadCalibration(
            f"{where}: <{element.tag}> has no {name}", "give the file as ATI delivered it"
        )
    return value


def _number(
    element: ElementTree.Element, name: str, where: str, default: str | None = None
) -> float:
    text = element.get(name, default)
    return _finite(
        _attribute(element, name, where) if text is None else text,
        f"{where}: <{element.tag}> {name}",
    )


def _finite(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise BadCalibration(
            f"{where} is {text!r}, not a number", "give the file as ATI delivered it"
        )
    return value
