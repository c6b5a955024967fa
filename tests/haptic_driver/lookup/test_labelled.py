"""Recordings and surfaces for pandas and xarray: the same numbers, under their names and units."""

import sys

import numpy as np
import pytest

from haptic_driver.errors import HapticError
from haptic_driver.lab.measuring.data_file import measured_frame, meta_path
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.recording.read import Run


@pytest.fixture
def run():
    samples = np.zeros(3, SAMPLE)
    samples["time_s"], samples["speed_m_s"], samples["measured_cof"] = (
        [1.0, 1.5, 2.0],
        [0.1, 0.2, 0.3],
        [0.6, np.nan, 0.7],
    )
    return Run("run_0001", {"rig": "bench", "simulated": True}, {}, samples, [])


def test_a_run_as_a_frame(run):
    frame = run.to_frame()
    assert list(frame.columns) == list(SAMPLE.names)
    assert frame["speed_m_s"].tolist() == [0.1, 0.2, 0.3]
    assert frame["measured_cof"].isna().tolist() == [False, True, False]
    assert frame.attrs["rig"] == "bench"
    assert frame.attrs["units"]["speed_m_s"] == "m/s"


def test_a_surface_over_its_axes(small_file):
    found = small_file.to_xarray()
    at = {"frequency_hz": 2, "voltage_v": 5, "normal_force_n": 1}
    assert float(found["cof"].isel(at)) == small_file.cof[2, 5, 1]
    assert found["stuck_current_a_per_v"].dims == ("frequency_hz", "voltage_v")
    assert found["stuck_current_a_per_v"].attrs["units"] == "A/V"
    assert found.attrs["content_hash"] == small_file.content_hash
    frame = small_file.to_frame()
    assert len(frame) == small_file.cof.size
    row = frame[
        (frame.frequency_hz == small_file.frequency_hz[2])
        & (frame.voltage_v == small_file.voltage_v[5])
    ].iloc[1]
    assert row["cof"] == small_file.cof[2, 5, 1]


def test_a_measured_table_has_phasors_and_what_its_sidecar_says(tmp_path):
    path = tmp_path / "data.csv"
    path.write_text(
        "frequency_hz,voltage_v,cof,current_a,current_phase_rad\n250,60,0.6,2e-6,1.5707963268\n250,0,0.5,,\n"
    )
    meta_path(path).write_text('{"rig": "bench"}')
    frame = measured_frame(path)
    assert frame["current"][0] == pytest.approx(2e-6j)
    assert np.isnan(frame["current"][1])
    assert frame["cof"].tolist() == [0.6, 0.5]
    assert frame.attrs["rig"] == "bench"
    assert (
        frame.attrs["units"] | {"current": "A", "current_phase_rad": "rad", "cof": "1"}
        == frame.attrs["units"]
    )


@pytest.mark.parametrize(("package", "method"), [("pandas", "to_frame"), ("xarray", "to_xarray")])
def test_a_package_that_is_missing_is_named_with_what_installs_it(
    run, monkeypatch, package, method
):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(HapticError) as caught:
        getattr(run, method)()
    assert caught.value.code == "missing_package"
    assert method in caught.value.message
    assert "haptic-driver[tables]" in caught.value.hint
