from __future__ import annotations

import numpy as np
import pytest

from hw.errors import DeviceDisconnected, DeviceError
from hw.force.ati_calibration import Array, AtiCalibration
from hw.force.sensor import ForceAxes, ForceReading, GaugeForceSensor, Wrench

# gauge i alone makes axis i, 10 N/V and 0.5 N m/V
CALIBRATION = AtiCalibration(
    serial="FT00000",
    part_number="test",
    calibrated_on="never",
    matrix=np.diag([10.0, 10.0, 10.0, 0.5, 0.5, 0.5]),
    full_scale=np.array([80.0, 80.0, 240.0, 4.0, 4.0, 4.0]),
    gauge_range_v=10.0,
)


class Gauges:
    def __init__(self) -> None:
        self.samples_v: Array = np.tile([1.0, -2.0, 0.5, 0.0, 0.0, 0.0], (4, 1))
        self.dead = False

    def latest_v(self, count: int) -> Array:
        if self.dead:
            raise DeviceDisconnected("card")
        return np.resize(self.samples_v, (count, 6))


def sensor(gauges: Gauges) -> GaugeForceSensor:
    axes = ForceAxes(normal="-z", lateral="x")
    return GaugeForceSensor(
        gauges, CALIBRATION, axes, samples_per_reading=4, samples_per_bias=8, clock=lambda: 1.5
    )


def test_the_bias_is_taken_off_the_gauges_and_the_axes_are_turned():
    gauges = Gauges()
    device = sensor(gauges)
    assert device.take_bias().tolist() == [1.0, -2.0, 0.5, 0.0, 0.0, 0.0]
    gauges.samples_v = gauges.samples_v + np.array([0.03, 0.0, -0.05, 0.0, 0.0, 0.2])
    assert device.read() == pytest.approx(ForceReading(1.5, 0.5, 0.3, False))
    wrench = device.read_wrench()
    assert wrench.force_n == pytest.approx((0.3, 0.0, -0.5))
    assert wrench.torque_n_m == pytest.approx((0.0, 0.0, 0.1))


def test_readings_are_means_over_their_samples():
    gauges = Gauges()
    device = sensor(gauges)
    device.take_bias()
    gauges.samples_v = gauges.samples_v + 0.01 * np.array([[1.0], [3.0], [-1.0], [1.0]])
    assert device.read().lateral_force_n == pytest.approx(0.1)


def test_one_that_is_connected_again_under_a_finger_keeps_the_bias_of_before():
    gauges = Gauges()
    before, again = sensor(gauges), sensor(gauges)
    before.take_bias()
    gauges.samples_v = gauges.samples_v + np.array([0.03, 0.0, -0.05, 0.0, 0.0, 0.2])
    again.keep_bias(before)
    assert again.read() == pytest.approx(ForceReading(1.5, 0.5, 0.3, False))


def test_without_a_bias_nothing_is_read():
    with pytest.raises(DeviceError, match="no bias"):
        sensor(Gauges()).read()


def test_a_bias_on_a_saturated_gauge_is_refused():
    gauges = Gauges()
    gauges.samples_v[2, 1] = 9.99
    with pytest.raises(DeviceError, match="without load"):
        sensor(gauges).take_bias()


@pytest.mark.parametrize("gauge_v", [9.95, -9.95, float("nan")])
def test_one_saturated_sample_marks_the_reading_though_the_mean_looks_well(gauge_v):
    gauges = Gauges()
    device = sensor(gauges)
    device.take_bias()
    gauges.samples_v[1, 5] = gauge_v
    assert device.read().saturated


def test_an_axis_beyond_its_calibration_marks_the_reading():
    gauges = Gauges()
    device = sensor(gauges)
    device.take_bias()
    gauges.samples_v[:, 0] += 8.01  # 80.1 N of 80, with the gauge at 9.01 V of 10
    assert device.read().saturated


@pytest.mark.parametrize(("normal", "lateral"), [("w", "x"), ("z", "-z")])
def test_axes_must_be_axes(normal, lateral):
    with pytest.raises(ValueError, match="axis"):
        ForceAxes(normal, lateral)


def test_every_axis_and_sign():
    wrench = Wrench(0.0, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0), True)
    assert ForceAxes("z", "-y").reading(wrench) == (0.0, 3.0, -2.0, True)
    assert ForceAxes("+x", "z").reading(wrench) == (0.0, 1.0, 3.0, True)
