"""The data sheets of simulated rigs find what the rigs' own files set, within 5 %."""

from __future__ import annotations

import datetime
from math import inf, log, pi, sqrt

import numpy as np
import pytest
from pypdf import PdfReader
from scipy.optimize import brentq

from haptic_driver.lab.papers.data_sheet import Measured, data_sheet, highest_current_a, sheet_facts
from haptic_driver.lab.papers.sheet_numbers import (
    cof_in_blocks,
    deviation_of,
    edge_errors_m,
    gains,
    half_power_hz,
    mean_of,
    noise_n,
    responses,
    touches,
)
from haptic_driver.lab.papers.sheet_passes import (
    ALWAYS,
    SLOW_M_S,
    SPEED_M_S,
    TOUCHES,
    Pass,
    SimulatedSlider,
    middle_of,
    other_passes,
    range_passes,
)
from haptic_driver.lab.papers.write import write
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import load_rig
from model.conditions import Conditions
from model.touch_model import TouchModel

RIGS = "simulated", "simulated-envelope"
TODAY = datetime.date(2026, 3, 1)
TOUCH = TouchModel(load_model("reference"))
pytestmark = [pytest.mark.soak, pytest.mark.timeout(1500)]  # half a minute each, idle


def predicted(frequency_hz, voltage_v, load_n=0.5):
    """The model itself, without surface, controller or limits."""
    f, v, n = np.broadcast_arrays(*map(np.atleast_1d, (frequency_hz, voltage_v, load_n)))
    return TOUCH.predict(Conditions(f.astype(float), v.astype(float), n.astype(float)))


@pytest.fixture(scope="module", params=RIGS)
def slid(request):
    """A rig, and what a finger met on it; the range at two loads and speeds, the rest whole."""
    config = load_rig(request.param)
    chosen = [
        p for p in range_passes() if (p.normal_force_n, p.speed_m_s) in ((0.5, 0.05), (1.0, 0.1))
    ]
    with SimulatedSlider(config, load_model("reference")) as finger:
        done = [(one, finger.slide(one)) for one in chosen]
        found = Measured(done)
        low, high = found.cof("low").value, found.cof("high").value
        done += [(one, finger.slide(one)) for one in other_passes(low, high)]
    return config, found


def near(value, expected) -> None:
    assert value == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize(("load_n", "speed_m_s"), [(0.5, 0.05), (1.0, 0.1)])
def test_friction_range_is_what_limits_and_model_allow(slid, load_n, speed_m_s):
    """The best carrier by trying all: 150 V, or what 0.5 mA and 0.2 mA per kHz leave of it."""
    _, found = slid
    f = np.geomspace(100.0, 1e6, 400)
    per_volt = predicted(f, 1.0).stuck_current_rms_a
    allowed_a = 1e-3 * np.clip(0.2 * f / 1e3, 0.5, 20.0)
    highest = np.nanmax(predicted(f, np.minimum(150.0, allowed_a / per_volt), load_n).cof)
    near(found.cof("low", load_n, speed_m_s).value, predicted(250.0, 0.0, load_n).cof[0])
    near(found.cof("high", load_n, speed_m_s).value, highest)


def test_fall_time_is_the_lag_of_friction(slid):
    """A first-order lag takes ln 9 time constants; its cut-off is 13.8 Hz per mm/s."""
    config, found = slid
    cutoff_hz = config.simulation.friction_cutoff_hz_per_mm_s * 1e3 * SLOW_M_S
    answer = responses(found.of("steps", SLOW_M_S)[0], rises=False)
    near(answer.ten_to_ninety_s.value, log(9.0) / (2.0 * pi * cutoff_hz))


def test_delay_is_that_of_the_instruments(slid):
    """Half an interval between set points, and the generator; ln 2 of friction's time constant."""
    config, found = slid
    lag_s = log(2.0) / (2.0 * pi * 13.8 * 1e3 * SPEED_M_S)
    answer = responses(found.of("steps", SPEED_M_S)[0], rises=False)
    if config.name == "simulated":
        waits_s = 0.5 * config.output.setpoint_interval_s
        near(answer.delay_s.value, waits_s + config.simulation.amplitude_latency_s + lag_s)
    else:  # written ahead by 3 ms, of which the tick that writes is one
        assert answer.delay_s.value - lag_s == pytest.approx(2e-3, abs=0.5e-3)  # half a tick


def test_rise_is_what_the_voltage_takes(slid):
    """At 10 V/ms; set points 10 ms apart show of it where it is then."""
    config, found = slid
    samples = found.of("steps", SPEED_M_S)[0]
    carrier_hz = samples["frequency_hz"][-1]
    asked = samples["asked_cof"]
    begins_v, ends_v = (
        np.max(samples["voltage_v"][asked == cof]) for cof in (np.nanmin(asked), ALWAYS)
    )
    begins, ends = predicted(carrier_hz, [begins_v, ends_v]).cof

    def reaches_v(share: float) -> float:
        wanted = begins + share * (ends - begins)
        return brentq(lambda v: predicted(carrier_hz, v).cof[0] - wanted, begins_v, ends_v)

    answer = responses(samples, rises=True)
    if config.name == "simulated-envelope":
        took_s = (reaches_v(0.9) - reaches_v(0.1)) / config.output.voltage_rise_v_per_s
        half_tick_s = 0.5e-3  # the last third of the change comes within one reading of 1 ms
        assert answer.ten_to_ninety_s.value == pytest.approx(took_s, abs=half_tick_s)
    else:
        ramp_s = (reaches_v(0.5) - begins_v) / config.output.voltage_rise_v_per_s
        latency_s = config.simulation.amplitude_latency_s
        soonest_s, latest_s = ramp_s + latency_s, ramp_s + latency_s + 0.010 + 0.001
        assert soonest_s < answer.delay_s.value < latest_s  # the ramp, then the next set point


def test_bandwidth_is_that_of_set_points_and_lag(slid):
    """A hold of 10 ms is a sinc, and an envelope follows friction that fades: its lag is left."""
    config, found = slid
    cutoff_hz = config.simulation.friction_cutoff_hz_per_mm_s * 1e3 * SLOW_M_S
    hold_s = config.output.setpoint_interval_s if config.name == "simulated" else 0.0

    def gain(hz: float) -> float:
        return float(np.sinc(hz * hold_s) / np.hypot(1.0, hz / cutoff_hz))

    expected_hz = brentq(lambda hz: gain(hz) - sqrt(0.5), 1.0, 90.0 if hold_s else 250.0)
    found_hz = half_power_hz(*gains(found.of("lines")[0]))
    near(found_hz.value, expected_hz)
    assert found_hz.low <= found_hz.value <= found_hz.high


def test_noise_is_that_of_the_sensor(slid):
    config, found = slid
    number = noise_n(found.of("touch"))
    near(number.value, config.simulation.force_noise_n)
    assert number.low < config.simulation.force_noise_n < number.high


def test_touches_that_are_alike_repeat(slid):
    """Readings of 3 mN on 0.5 N, a hundred in a block: nothing else differs."""
    _, found = slid
    within, between = touches(found.of("touch"))
    cof = np.mean([cof_in_blocks(samples).mean() for samples in found.of("touch")])
    one = 3e-3 / 0.5 * sqrt(1.0 + 1.0 / cof**2) / 10.0
    assert within.low < one < within.high
    assert between.value < one  # of eight touches of four blocks: half of it at most, mostly


def test_highest_currents_are_those_of_the_highest_voltage(slid):
    config, found = slid
    out = np.concatenate([samples for _, samples in found.passes])
    i = int(np.argmax(out["voltage_v"]))
    loads = np.array([0.5, 1.0])
    answer = predicted(out["frequency_hz"][i], out["voltage_v"][i], loads)
    sliding_a, stuck_a = highest_current_a(found, config, load_model("reference"))
    near(sliding_a, answer.current_rms_a.max())
    near(stuck_a, answer.stuck_current_rms_a.max())


def test_touches_that_differ_are_told():
    """A finger that has another friction at each touch, by gains that the test sets."""
    gain = 1.0 + 0.04 * np.array([-1.2, -0.7, -0.2, 0.1, 0.5, 1.5])
    found = []
    with SimulatedSlider(load_rig("simulated"), load_model("reference")) as finger:
        for one in gain.tolist():
            finger.bench.instruments.finger_gain = one
            found.append(finger.slide(Pass("touch", range_passes()[0].target, 0.5, 0.05, 0.5)))
    _, between = touches(found)
    near(between.value, gain.std(ddof=1) / gain.mean())


def test_a_wrong_latency_shows_as_a_position_error():
    """20 ms that the file does not tell of are 2 mm at 100 mm/s."""
    errors = {}
    rig = load_rig("simulated-envelope")
    for wrong_s in (0.0, 0.020):
        output = rig.output.model_copy(update={"latency_s": wrong_s})
        config = rig.model_copy(update={"output": output})
        with SimulatedSlider(config, load_model("reference")) as finger:
            low, high = predicted(250.0, 0.0).cof[0], 1.35
            asked = next(
                p for p in other_passes(low, high) if p.what == "edges" and p.speed_m_s == 0.1
            )
            errors[wrong_s] = mean_of(
                edge_errors_m(finger.slide(asked), low, middle_of(low, high))
            ).value
    assert abs(errors[0.0]) < 0.1e-3  # the driver makes up for what it knows of
    near(errors[0.0] - errors[0.020], 0.1 * 0.020)  # friction comes before its place


def test_the_sheet_is_one_page_with_every_number(slid, tmp_path):
    config, found = slid
    whole = [
        (one._replace(normal_force_n=n, speed_m_s=v), samples)
        for one, samples in found.passes[:2]
        for n in (0.25, 0.5, 1.0)
        for v in (0.02, 0.05, 0.1)
    ]
    paper = Measured([*whole, *found.passes[4:]])
    facts = sheet_facts(paper, config, load_model("reference"), TODAY)
    assert len(facts["range"]) == 9
    assert [n for n, one in facts["numbers"].items() if one["value"] is None] == []
    assert all(one["how"] and one["what"] for one in facts["numbers"].values())
    write(data_sheet(paper, facts), tmp_path / "sheet.pdf")
    (page,) = PdfReader(tmp_path / "sheet.pdf").pages
    shown = " ".join(page.extract_text().split())
    assert "simulated" in shown
    assert "the model's force grows with voltage" in shown  # at the highest voltage, as published
    assert [one["what"] for one in facts["numbers"].values() if one["what"] not in shown] == []


def test_intervals_by_their_tables():
    """Student's t of four values is 3.182, chi square of three degrees 0.2158 and 9.348."""
    values = np.array([1.0, 2.0, 3.0, 4.0])
    deviation = sqrt(5.0 / 3.0)
    mean, spread = mean_of(values), deviation_of(values)
    assert mean == pytest.approx(
        (2.5, 2.5 - 3.182 * deviation / 2, 2.5 + 3.182 * deviation / 2), rel=1e-3
    )
    assert spread == pytest.approx(
        (deviation, deviation * sqrt(3 / 9.348), deviation * sqrt(3 / 0.2158)), rel=1e-3
    )
    assert not mean_of([1.0]).is_known


def test_gain_that_never_falls_ends_with_the_lines():
    flat = half_power_hz(np.ones(12), np.full(12, 1e-6))
    assert flat.value < inf
    assert flat.value == flat.high == 256.0
    assert len([p for p in other_passes(0.5, 1.3) if p.what == "touch"]) == TOUCHES
