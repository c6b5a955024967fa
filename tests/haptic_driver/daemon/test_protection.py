"""What protects comes from the model that a person signed, whatever is rendered by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from haptic_driver.config import find_config
from haptic_driver.daemon.set_up import DaemonSettings, daemon_settings, render_settings
from haptic_driver.lookup.build import SurfaceAxes, build_surface
from haptic_driver.lookup.models import load_model
from haptic_driver.render.safety import Worst, violation, worst_at
from haptic_driver.rig.config import load_rig
from haptic_driver.signals import OperatingPoint
from model.conditions import Conditions
from model.description import ModelDescription
from model.parameters import Parameter
from model.reporting.model_file import dielectric_entry, model_text
from model.touch_model import TouchModel
from tests.haptic_driver.config_texts import changed

AXES = SurfaceAxes(frequency_count=12, voltage_count=10, normal_force_count=4)
PLACES = [(f, v) for f in (200.0, 841.0, 20e3, 466e3) for v in (20.0, 60.0, 120.0)]


def drier(model: ModelDescription, wetness: float) -> ModelDescription:
    hydration = {"skin_hydration": {"wetness": Parameter(wetness, "", "fit to data")}}
    return replace(model, effect_parameters=model.effect_parameters | hydration)


def smaller(model: ModelDescription, factor: float) -> ModelDescription:
    return model.with_values(contact_area_m2=factor * model.parameters["contact_area_m2"].value)


REFITS = {
    "wetness -1": lambda model: drier(model, -1.0),
    "wetness -2": lambda model: drier(model, -2.0),
    "half the area": lambda model: smaller(model, 0.5),
    "twice the area": lambda model: smaller(model, 2.0),
}


@pytest.fixture(scope="module")
def first():
    config = load_rig("simulated")
    one_touch = config.limits.model_copy(update={"touching_area_m2": None})
    config = config.model_copy(update={"limits": one_touch})
    surface = build_surface(load_model("reference"), config.operating_limits(), AXES)
    return DaemonSettings(
        "simulated", "reference", config, surface, render_settings(config, surface)
    )


def worst(settings: DaemonSettings) -> np.ndarray:
    """What the gate takes for finger current and electrode voltage per volt [place, 2]."""
    table = settings.render.tick.worst_case
    return np.array([worst_at(table, *place) for place in PLACES])


@pytest.mark.parametrize("name", REFITS)
def test_no_refit_lets_the_gate_pass_what_the_signed_model_forbids(first, name):
    refitted = build_surface(
        REFITS[name](load_model("reference")), first.config.operating_limits(), AXES
    )
    after = first.with_surface(refitted, 1)
    alone = replace(first, signed=refitted).with_surface(refitted, 1)
    assert (worst(after) >= worst(first)).all()
    assert (worst(after) >= worst(alone)).all()
    lifts = (worst(alone) < 0.7 * worst(first)).any()
    assert lifts == (name != "twice the area")  # or this shows nothing
    allowed = [each.config.operating_limits() for each in (first, after)]
    before_v, after_v = (
        limits.highest_within_v(each.protected.worst_case(limits))
        for limits, each in zip(allowed, (first, after), strict=True)
    )
    assert (after_v <= before_v).all()
    assert after.surface.content_hash == refitted.content_hash


@pytest.mark.parametrize("touching_m2", [471e-6, 684e-6])
def test_a_hand_gets_no_more_than_one_finger_may(first, touching_m2):
    """684 mm2 of stuck fingers once carried 6.8 times the limit at a voltage allowed for one."""
    hand = first.config.limits.model_copy(update={"touching_area_m2": touching_m2})
    config = first.config.model_copy(update={"limits": hand})
    limits, one = config.operating_limits(), first.config.operating_limits()
    table = render_settings(config, first.surface).tick.worst_case
    held_v = limits.highest_within_v(first.surface.worst_case(limits))
    one_v = one.highest_within_v(first.surface.worst_case(one))
    f = first.surface.frequency_hz
    stuck_a = (
        TouchModel(load_model("reference"))
        .predict(Conditions(f, held_v, np.full(f.size, 0.5)))
        .stuck_current_rms_a
    )
    share = stuck_a * touching_m2 / 100e-6 / limits.contact_current_limit_a_rms(f)
    assert 0.99 < share.max() <= 1.0 + 1e-9
    for frequency_hz, allowed_v, forbidden_v in zip(f, held_v, one_v, strict=True):
        found = [
            violation(
                limits,
                OperatingPoint(frequency_hz, v, 0.6, 0.0, 0.0, True, 0.5, 1.0),
                Worst(*worst_at(table, frequency_hz, v)),
            )
            for v in ((1.0 - 1e-9) * allowed_v, forbidden_v)
        ]
        assert found[0] is None
        assert (found[1] is not None) == (forbidden_v > allowed_v)
    assert (one_v > 4.0 * held_v).any()


def test_another_axis_is_judged_by_the_signed_model_there(first):
    """A surface that ends elsewhere, as one with a learned effect does."""
    axes = replace(AXES, voltage_high_v=120.0, frequency_high_hz=3e5)
    small = smaller(load_model("reference"), 0.5)
    limits = first.config.operating_limits()
    found = build_surface(small, limits, axes).protected_by(first.surface)
    own = build_surface(load_model("reference"), limits, axes)
    np.testing.assert_array_equal(found.stuck_current_a_per_v, own.stuck_current_a_per_v)
    np.testing.assert_array_equal(found.electrode_gain, own.electrode_gain)


@pytest.mark.parametrize("signs", ["", "itself"])
def test_a_fit_protects_nobody_until_a_person_signs_it(tmp_path, signs):
    model = drier(load_model("reference"), -2.0)
    path, rig = tmp_path / "dry.toml", tmp_path / "rig.toml"
    path.write_text(model_text(model, dielectric_entry(model, tmp_path), {}))
    config = load_rig("simulated")
    text = find_config("simulated", "rigs").read_text()
    rig.write_text(changed(text, ("[limits]", f'[limits]\nmodel = "{path}"')) if signs else text)
    assert load_model(str(path)).is_fitted
    settings = daemon_settings(str(rig), str(path))
    limits = config.operating_limits()
    highest_v = limits.highest_within_v(settings.protected.worst_case(limits))
    published = build_surface(load_model("reference"), limits)
    published_v = limits.highest_within_v(published.worst_case(limits))
    assert (highest_v > 1.1 * published_v).any() == bool(signs)
