"""Calibration files made from an independent matrix, in both forms, by the rule of the file
format.
"""

from __future__ import annotations

import re

import numpy as np
import pytest

from hw.force.ati_calibration import AtiCalibration, BadCalibration

AXES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
# N/V and N m/V about the point of use; of a size as for a transducer of 80 N and 4 N m at 10 V
MATRIX = np.array(
    [
        [-0.12, 0.06, 0.15, -13.81, -0.09, 14.03],
        [0.09, 16.01, 0.02, -8.06, 0.15, -8.05],
        [24.72, -0.33, 25.07, -0.55, 24.87, -0.78],
        [0.001, 0.103, -0.721, -0.033, 0.719, -0.080],
        [0.834, -0.014, -0.412, 0.101, -0.413, -0.075],
        [0.004, -0.421, 0.007, -0.424, 0.002, -0.418],
    ]
)
MAXIMA = (80.0, 80.0, 240.0, 4.0, 4.0, 4.0)
SCALES = (2.34, 2.34, 0.748, 44.82, 44.82, 44.0)
DZ_M = 0.00701


def axis(tag: str, name: str, values: np.ndarray, maximum: float, extra: str = "") -> str:
    row = " ".join(f"{value:.8f}" for value in values)
    return f'<{tag} Name="{name}" values=" {row} " max="{maximum}"{extra}/>'


def old_axes(matrix: np.ndarray, dz: float) -> str:
    """Undo Tx += Dz Fy and Ty -= Dz Fx, then multiply by the scale."""
    at_origin = matrix.copy()
    at_origin[3] = matrix[3] - dz * matrix[1]
    at_origin[4] = matrix[4] + dz * matrix[0]
    rows = zip(AXES, at_origin, MAXIMA, SCALES, strict=True)
    return "".join(
        axis("Axis", name, row * scale, top, f' scale="{scale}"') for name, row, top, scale in rows
    )


def new_axes(matrix: np.ndarray) -> str:
    return "".join(axis("UserAxis", *row) for row in zip(AXES, matrix, MAXIMA, strict=True))


def file_of(body: str, units: str = 'ForceUnits="N" TorqueUnits="N-m" DistUnits="m"') -> bytes:
    return (
        '<?xml version="1.0" encoding="utf-8"?><!-- a note --><FTSensor Serial="FT00001"'
        ' BodyStyle="Mini40" Family="DAQ" NumGages="6" CalFileVersion="1.1"><Calibration'
        f' PartNumber="SI-80-4" CalDate="3/5/2014" {units} OutputMode="Ground Referenced'
        ' Differential" OutputRange="20" HWTempComp="True" GainMultiplier="1"'
        f' CableLossDetection="False" OutputBipolar="True">{body}</Calibration></FTSensor>'
    ).encode()


TRANSFORM = f'<BasicTransform Dx="0" Dy="0" Dz="{DZ_M}" Rx="0" Ry="0" Rz="0"/>'
BOTH = file_of(old_axes(MATRIX, DZ_M) + TRANSFORM + new_axes(MATRIX))
OLD = file_of(old_axes(MATRIX, DZ_M) + TRANSFORM)


def test_both_forms_give_the_matrix_they_were_made_from():
    """The rule measured on a real file that holds both: 36 entries within 1e-5."""
    for xml in (BOTH, OLD, file_of(new_axes(MATRIX))):
        np.testing.assert_allclose(AtiCalibration.from_xml(xml, "file").matrix, MATRIX, atol=1e-5)


def test_the_newer_elements_win():
    other = file_of(old_axes(2.0 * MATRIX, DZ_M) + TRANSFORM + new_axes(MATRIX))
    np.testing.assert_allclose(AtiCalibration.from_xml(other, "file").matrix, MATRIX, atol=1e-7)


def test_units_are_turned_into_newtons_and_metres():
    """A Nano17 file is in N, N-mm and mm: the same sensor, its torque rows and displacement 1000
    times larger.
    """
    in_mm = MATRIX.copy()
    in_mm[3:] *= 1e3
    units = 'ForceUnits="N" TorqueUnits="N-mm" DistUnits="mm"'
    transform = TRANSFORM.replace(f"{DZ_M}", f"{1e3 * DZ_M}")
    for body in (old_axes(in_mm, 1e3 * DZ_M) + transform, new_axes(in_mm)):
        calibration = AtiCalibration.from_xml(file_of(body, units), "file")
        np.testing.assert_allclose(calibration.matrix, MATRIX, atol=1e-5)
        assert calibration.full_scale[3:].tolist() == pytest.approx([4e-3] * 3)
    pounds = AtiCalibration.from_xml(
        file_of(new_axes(MATRIX), 'ForceUnits="lbf" TorqueUnits="lbf-in" DistUnits="in"'), "file"
    )
    assert pounds.matrix[0, 5] == pytest.approx(14.03 * 4.4482216, rel=1e-6)
    assert pounds.matrix[5, 5] == pytest.approx(-0.418 * 0.11298483, rel=1e-6)


def test_a_known_load_comes_back():
    bias_v = np.array([0.3, -0.2, 0.1, 0.5, -0.4, 0.05])
    load = np.array([0.3, -0.1, -0.5, 0.01, -0.02, 0.003])
    gauges_v = np.linalg.solve(MATRIX, load) + bias_v
    np.testing.assert_allclose(
        AtiCalibration.from_xml(BOTH, "file").wrench(gauges_v, bias_v), load, atol=1e-6
    )


def test_what_the_file_says_of_the_transducer(tmp_path):
    path = tmp_path / "FT00001.cal"
    path.write_bytes(BOTH)
    calibration = AtiCalibration.from_file(path)
    assert (calibration.serial, calibration.part_number, calibration.calibrated_on) == (
        "FT00001",
        "SI-80-4",
        "3/5/2014",
    )
    assert calibration.gauge_range_v == 10.0
    assert tuple(calibration.full_scale) == MAXIMA
    assert not calibration.saturated(np.full(6, 9.8))
    assert calibration.saturated(np.array([0.0, 0.0, -9.95, 0.0, 0.0, 0.0]))


def replaced(old: str, new: str, xml: bytes = BOTH) -> bytes:
    text = xml.decode()
    assert re.search(old, text)
    return re.sub(old, new, text, count=1).encode()


@pytest.mark.parametrize(
    ("xml", "says"),
    [
        (b"time,force\n1,2\n", "not XML"),
        (b"<FTSensor/>", "no <Calibration>"),
        (replaced('Family="DAQ"', 'Family="Net"'), "Family is 'Net'"),
        (replaced('OutputBipolar="True"', 'OutputBipolar="False"'), "OutputBipolar"),
        (replaced('ForceUnits="N"', 'ForceUnits="Newton"'), "unknown unit 'Newton'"),
        (replaced("<UserAxis Name=.Tz.[^>]*>", ""), "missing: Tz"),
        (
            replaced('<UserAxis Name="Fx" values=" -0.12000000', '<UserAxis Name="Fx" values="'),
            "5 values",
        ),
        (
            replaced(
                '<UserAxis Name="Fx" values=" -0.12000000', '<UserAxis Name="Fx" values=" nan'
            ),
            "not a number",
        ),
        (replaced("<BasicTransform[^>]*>", "", OLD), "neither"),
        (replaced('Rx="0"', 'Rx="1"', OLD), "rotated"),
    ],
)
def test_wrong_files_say_what_is_wrong_and_where(xml, says):
    with pytest.raises(BadCalibration, match=re.escape(says)) as caught:
        AtiCalibration.from_xml(xml, "lab/FT1.cal")
    assert "lab/FT1.cal" in caught.value.message


def test_a_missing_file_says_so(tmp_path):
    with pytest.raises(BadCalibration, match="cannot be read") as refused:
        AtiCalibration.from_file(tmp_path / "none.cal")
    assert refused.value.code == "bad_calibration"
