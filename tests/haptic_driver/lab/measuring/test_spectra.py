"""Spectra against Kramers and Kronig: circuits written down here pass, what changes on the way does
not.
"""

from __future__ import annotations

import datetime
import json
from pathlib import Path

import numpy as np
import pytest

from haptic_driver.lab.measuring.data_file import COLUMNS, meta_path
from haptic_driver.lab.measuring.spectra import mark_spectra, passes
from tests.haptic_driver.commands import rows_of

F = np.geomspace(10.0, 1e6, 21)
W = 2 * np.pi * F
TODAY = datetime.date(2026, 3, 1)


def circuits() -> dict[str, np.ndarray]:
    """Linear, causal and stable, none of them made of the fit's own elements."""
    skin = 2e5 / (1 + (1j * W * 3e-4) ** 0.75)  # Cole and Cole
    gap = 1 / (1j * W * 800e-12)
    warburg = 3e6 / np.sqrt(1j * W)
    stray = 1j * W * 300e-12
    return {
        "stray alone": 1 / stray,
        "skin through an air gap": 1 / (stray + 1 / (skin + gap)),
        "with diffusion and a resistor": 500.0 + 1 / (stray + 1 / (skin + warburg)),
        "bridged gap": 1 / (stray + 1 / (skin + 1 / (1 / gap + 1e-6))),
    }


@pytest.mark.parametrize("name", circuits())
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_what_obeys_the_relations_passes(name, noise):
    z = circuits()[name]
    rng = np.random.default_rng(3)
    z = z * (1 + noise * (rng.standard_normal(z.size) + 1j * rng.standard_normal(z.size)))
    assert passes(F, z, np.full(F.size, noise)).all()


@pytest.mark.parametrize("name", circuits())
@pytest.mark.parametrize("i", [3, 10, 17])
def test_one_row_that_is_off_is_the_one_that_fails(name, i):
    for factor in (1.3, np.exp(0.3j)):
        z = circuits()[name].copy()
        z[i] *= factor
        good = passes(F, z, np.full(F.size, 0.002))
        assert not good[i]
        assert good.sum() >= F.size - 2


def test_a_spectrum_that_breaks_the_relations_fails_as_a_whole():
    """A resistance that an amount alone tells, with a capacitor's phase."""
    z = 1e5 * (1 + 0.5 * np.sin(3 * np.log(F))) * np.exp(-1.5j)
    assert not passes(F, z, np.full(F.size, 0.002)).any()


def written(path: Path, spectra: dict[str, np.ndarray], rows: int = 21) -> Path:
    """A data file of sweeps at 5 V; the finger's name may carry a session's number."""
    lines = []
    for name, impedance in spectra.items():
        finger, _, session = name.partition(" ")
        for f, z in list(zip(F, impedance, strict=True))[:rows]:
            said = {
                "frequency_hz": f,
                "voltage_v": 5.0,
                "normal_force_n": 0.0 if finger == "none" else 0.5,
                "speed_m_s": 0.0,
                "time_s": 1.0,
                "session": session or 1,
                "trial": 1,
                "waveform": "sine",
                "finger": finger,
                "electrode_voltage_v": 5.0,
                "electrode_voltage_std_v": 0.005,
                "electrode_voltage_phase_rad": -0.1,
                "electrode_voltage_phase_std_rad": 0.001,
                "current_a": 5.0 / abs(z),
                "current_std_a": 0.001 * 5.0 / abs(z),
                "current_phase_rad": -0.1 - np.angle(z),
                "current_phase_std_rad": 0.001,
                "simulated": "true",
            }
            lines.append([str(said.get(column, "")) for column in COLUMNS])
    path.write_text("\n".join(map(",".join, [COLUMNS, *lines])) + "\n")
    meta_path(path).write_text("{}")
    return path


def marks(path: Path) -> list[str]:
    return [row["kramers_kronig"] for row in rows_of(path)]


def test_rows_are_marked_and_nothing_else_changes(tmp_path):
    z = circuits()
    bad = z["bridged gap"].copy()
    bad[5] *= 1.5
    path = written(
        tmp_path / "data.csv",
        {"none": z["stray alone"], "resting": z["bridged gap"], "resting 2": bad},
    )
    before = path.read_text()
    failed, stray = mark_spectra(path, TODAY)
    assert failed == marks(path).count("fails") >= 1
    assert marks(path)[:42] == ["passes"] * 42
    assert marks(path)[42 + 5] == "fails"
    assert path.read_text().replace("passes", "").replace("fails", "") == before
    assert stray is not None
    assert stray.capacitance_f == pytest.approx(300e-12, rel=1e-9)
    assert stray.std_f == pytest.approx(300e-12 * np.sqrt(2) * 1e-3 / np.sqrt(21), rel=1e-6)
    assert stray.measured_at == "2026-03-01"
    assert json.loads(meta_path(path).read_text())["stray_capacitance"] == stray._asdict()


def test_an_open_circuit_that_is_no_capacitance_gives_no_number(tmp_path):
    """A resistor of 1 MOhm: what the rows hold of a capacitance is their noise."""
    z = np.full(F.size, 1e6 + 0j)
    _, stray = mark_spectra(written(tmp_path / "data.csv", {"none": z}), TODAY)
    assert stray is not None
    assert stray.capacitance_f is None
    assert "not distinguishable from zero" in stray.why_none
    assert stray.as_parameter().startswith("# ")
    huge = 1.0 / (2j * np.pi * F * 2e-6)
    _, stray = mark_spectra(written(tmp_path / "data.csv", {"none": huge}), TODAY)
    assert stray is not None
    assert stray.capacitance_f is None
    assert "above 1e-06 F" in stray.why_none


def test_too_few_rows_to_tell_are_left_unmarked_and_no_open_circuit_is_no_calibration(tmp_path):
    z = circuits()["bridged gap"]
    path = written(tmp_path / "data.csv", {"resting": z}, rows=6)
    assert mark_spectra(path, TODAY) == (0, None)
    assert marks(path) == [""] * 6


def test_an_open_circuit_that_fails_calibrates_nothing(tmp_path):
    z = 1e5 * (1 + 0.5 * np.sin(3 * np.log(F))) * np.exp(-1.5j)
    assert mark_spectra(written(tmp_path / "data.csv", {"none": z}), TODAY) == (21, None)
