"""A camera's features are read back, and of a burst all frames are kept that came whole."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hw.camera.genicam import OPTIONAL, GenicamCamera, GenicamSettings
from hw.errors import DeviceError, DeviceTimeout, InstrumentRejected
from tests.hw.testing.genicam import FEATURES, install

SETTINGS = GenicamSettings("a.cti", count=4, rate_hz=20.0, exposure_s=5e-4)


@pytest.fixture
def device(monkeypatch):
    return install(monkeypatch)


def opened() -> GenicamCamera:
    camera = GenicamCamera(SETTINGS)
    camera.open()
    return camera


def test_settings_reach_the_features_by_their_standard_names(device):
    opened()
    set_to = {name: feature.value for name, feature in device.features.items()}
    assert (set_to["PixelFormat"], set_to["AcquisitionFrameCount"]) == ("Mono8", 4)
    assert set_to["AcquisitionFrameRate"] == 20.0
    # microseconds
    assert set_to["ExposureTime"] == pytest.approx(500.0)
    assert (set_to["ExposureAuto"], set_to["GainAuto"]) == ("Off", "Off")


@pytest.mark.parametrize("name", FEATURES)
def test_a_feature_that_is_not_there_is_named_or_is_none_that_every_camera_has(device, name):
    del device.features[name]
    if name in OPTIONAL:
        assert name not in {one.name for one in opened().held()}
    else:
        with pytest.raises(InstrumentRejected, match=f"no {name}"):
            opened()


@pytest.mark.parametrize("name", FEATURES)
def test_a_feature_that_refuses_is_named(device, name):
    def refuses(value: object) -> None:
        raise RuntimeError("AccessException: Node is not writable.")

    device.features[name]._makes = refuses
    with pytest.raises(InstrumentRejected, match=rf"{name} .*not writable"):
        opened()


def test_an_exposure_of_whole_lines_is_taken_in(device):
    device.features["ExposureTime"]._makes = lambda value: value + 6.0
    held = {one.name: one.got for one in opened().held()}
    assert held["ExposureTime"] == pytest.approx(506.0)


def burst(camera: GenicamCamera) -> list[tuple[float, np.ndarray]]:
    camera.start()
    return [(frame.time_s, frame.image) for frame in camera.frames()]


def test_what_came_before_the_camera_fell_silent_is_kept(device):
    device.frames_there = 2
    assert len(burst(opened())) == 2
    assert not device.is_acquiring()


@pytest.mark.parametrize(("incomplete", "there"), [({0, 1, 2, 3}, 9), (set(), 0)])
def test_a_burst_without_a_whole_frame_says_why(device, incomplete, there):
    device.incomplete, device.frames_there = incomplete, there
    with pytest.raises(DeviceTimeout, match=r"incomplete|time is up") as caught:
        burst(opened())
    assert caught.value.hint


@pytest.mark.parametrize("sends", ["Mono12p", None])
def test_packed_pixels_are_named(device, sends):
    device.sends = sends
    with pytest.raises(DeviceError, match=sends or "not understood") as caught:
        burst(opened())
    assert "Mono8" in caught.value.hint
    assert not device.is_acquiring()


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    lost=st.sets(st.integers(0, 3)),
    empty=st.sets(st.integers(0, 3)),
    there=st.integers(0, 5),
    padding=st.integers(0, 40),
    in_nanoseconds=st.booleans(),
)
def test_of_any_burst_the_whole_frames_are_kept(
    device, lost, empty, there, padding, in_nanoseconds
):
    device.incomplete, device.empty, device.frames_there = lost, empty, there
    device.padding, device.in_nanoseconds = padding, in_nanoseconds
    whole = [i for i in range(min(there, SETTINGS.count)) if i not in lost | empty]
    if not whole:
        with pytest.raises(DeviceError):
            burst(opened())
        return
    found = burst(opened())
    step_s = 0.02 if in_nanoseconds else 0.025
    assert [t for t, _ in found] == pytest.approx([step_s * (i - whole[0]) for i in whole])
    for number, (_, image) in zip(whole, found, strict=True):
        assert np.array_equal(image, device.picture(number))
