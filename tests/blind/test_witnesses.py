"""The generator's electrical side against limits and published sizes; twins; how witnesses are
scored.
"""

import numpy as np
import pytest

from .generator import build, designs, nuisance, touch, witnesses
from .generator.__main__ import csv_text
from .generator.effects import (
    CATALOGUE,
    CATALOGUE_EFFECTS,
    FORMS,
    SECOND_STRANGERS,
    THIRD_STRANGERS,
)
from .generator.electrode import Rig, observe, touch_admittance
from .scores import Answer
from .witness_table import is_wrong

FREQUENCIES = np.array([10.0, 100.0, 250.0, 1e3, 1e4, 1e5, 1e6])
# electrical.md, "Sizes": total current in A peak and its phase in rad; 0.5 N, sliding, 5 V, 300 pF
# beside the touch
SIZES = np.array([1.13e-6, 3.89e-6, 4.78e-6, 1.17e-5, 1.08e-4, 1.08e-3, 1.08e-2])
PHASES = np.array([1.31, 0.60, 0.74, 1.25, 1.53, 1.56, 1.55])
# physics.md section 6: peak current of a sliding finger at 75 V and 0.5 N, A
SLIDING_HZ = np.array([250.0, 1e3, 1e4, 1e5, 1e6])
SLIDING_A = np.array([0.060e-3, 0.067e-3, 0.25e-3, 2.4e-3, 24e-3])


def state_at(f, volts, finger=nuisance.REFERENCE):
    same = np.ones(np.size(f))
    rows = touch.Rows(np.asarray(f, float), volts * same, 0.5 * same, 0.02 * same, 0 * same)
    return touch.prepare(rows, finger, touch.Roughness())


def total(leak=1.0, stray_f=300e-12):
    state = state_at(FREQUENCIES, 5.0, touch.Finger(leak=leak))
    return 5.0 * (touch_admittance(state) + 2j * np.pi * FREQUENCIES * stray_f)


def test_sliding_current_has_the_published_size():
    current = 75.0 * np.abs(touch_admittance(state_at(SLIDING_HZ, 75.0)))
    assert current == pytest.approx(SLIDING_A, rel=0.02)  # two digits are published


def test_total_current_has_the_published_size():
    # Within 7 % and 0.04 rad as it stands: the table's touch leaks 9 % more, and 2 % less flows
    # beside it, than its caption says. With these two every entry comes out within its last digit
    # (0.5 %, 0.006 rad). Nothing says why.
    assert np.abs(total()) == pytest.approx(SIZES, rel=0.07)
    assert np.angle(total()) == pytest.approx(PHASES, abs=0.04)
    mended = total(leak=np.exp(0.0896), stray_f=300e-12 * np.exp(-0.0173))
    assert np.abs(mended) == pytest.approx(SIZES, rel=0.005)
    assert np.angle(mended) == pytest.approx(PHASES, abs=0.006)


def test_butterworth_of_second_order_has_its_phase():
    state = state_at(FREQUENCIES, 5.0)
    CATALOGUE_EFFECTS["amplifier_bandwidth"].apply(state, 1e6 / 3e3, {"order": 2}, False)
    x = 1j * FREQUENCIES / 3e3
    gain = 1 / (1 + np.sqrt(2) * x + x**2)
    assert state.drive * np.exp(1j * state.drive_phase) == pytest.approx(5.0 * gain)


def test_a_slewing_amplifier_makes_what_a_tracker_makes():
    slew, steps = 6e4, 4000
    state = state_at([1e3], 50.0)
    CATALOGUE_EFFECTS["amplifier_slew_limit"].apply(state, 5e8 / slew, {}, False)
    t = np.arange(30 * steps) / steps / 1e3
    most, out, got = slew / steps / 1e3, 0.0, []
    for want in (50.0 * np.sin(2e3 * np.pi * t)).tolist():
        out += min(max(want - out, -most), most)
        got.append(out)
    last = 2 * np.mean((got * np.exp(-2e3j * np.pi * t))[-steps:]) * 1j  # against the sine
    assert state.drive[0] == pytest.approx(np.abs(last), rel=2e-3)
    assert state.drive_phase[0] == pytest.approx(np.angle(last), abs=2e-3)


@pytest.fixture(scope="module")
def base():
    """A design, and what is read of the usual finger by it."""
    design = designs.witnesses(np.random.default_rng(1))
    return design, witnesses.stacked(observe(design, touch.Finger(), Rig(), ()))


@pytest.mark.parametrize(
    ("effect", "form"),
    [(e, form) for e in CATALOGUE_EFFECTS.values() for form in FORMS[1:]]
    + [(e, CATALOGUE) for e in (SECOND_STRANGERS | THIRD_STRANGERS).values()],
    ids=lambda given: given if isinstance(given, str) else given.name,
)
def test_no_strength_leaves_every_witness_and_full_strength_some(base, effect, form):
    design, plain = base
    hidden = witnesses.draw_hidden(np.random.default_rng(2), effect, form)
    off, on = (
        witnesses.stacked(observe(design, touch.Finger(), Rig(), (hidden.at(strength),)))
        for strength in (0.0, hidden.knob[1])
    )
    for witness, values in plain.items():
        np.testing.assert_array_equal(off[witness], values)
        np.testing.assert_array_equal(np.isfinite(on[witness]), np.isfinite(values))
    assert max(np.nanmax(np.abs(on[witness] - plain[witness])) for witness in plain) > 0.05


@pytest.fixture(scope="module")
def pair():
    spec = build.Spec("W1", 0, (("series_resistance", 300.0),), design="witnesses")
    return witnesses.build_pair(spec, 4)


def test_twins_share_truth_and_friction(pair):
    both, alone = pair
    slides = ~np.isnan(both.columns["cof"])
    for name, values in alone.columns.items():
        assert np.array_equal(both.columns[name][slides], values), name
    assert both.label["effects"][0]["lambda"] == pytest.approx(300.0, rel=0.05)
    assert both.label["effects"][0]["parameters"] == alone.label["effects"][0]["parameters"]
    assert "finger" in csv_text(both.columns).splitlines()[0].split(",")


def test_an_open_circuit_shows_the_stray_capacitance_alone(pair):
    c, rig = pair[0].columns, pair[0].label["rig"]
    none = c["finger"] == "none"
    farads = c["current_a"][none] / (
        2 * np.pi * c["frequency_hz"][none] * c["electrode_voltage_v"][none]
    )
    noise = np.hypot(pair[0].label["noise"]["current"], pair[0].label["noise"]["voltage"])
    # noise averages; gains of current (2 %) and voltage (1 %) and the open circuit (1 %) do not:
    # three sigma
    assert np.median(farads) == pytest.approx(rig["stray_f"], rel=3 * np.hypot(noise / 4, 0.025))
    assert np.isnan(c["cof"][none]).all()


@pytest.mark.parametrize(
    ("names", "adequate", "wrong"),
    [
        (("a", "b"), True, False),
        (("a",), True, True),
        (("a",), False, False),
        (("a", "c"), False, True),
    ],
)
def test_one_name_of_two_called_adequate_is_wrong(names, adequate, wrong):
    label = {"effects": [{"name": "a", "lambda": 200.0}, {"name": "b", "lambda": 100.0}]}
    got = Answer("effect_found", names, (), names[0], 0.97, "none", "none", adequate=adequate)
    assert is_wrong(label, got) is wrong
