"""What protects comes from the model that a person signed, whatever is rendered by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from haptic_driver.config import find_config
from haptic_driver.daemon.set_up import DaemonSettings, daemon_settings, render_settings
from haptic_driver.lookup.build import SurfaceAxes, build_surface
from haptic_driver.lookup.models import load_model
from haptic_driver.render.safety import worst_at
from haptic_driver.rig.config import load_rig
from model.description import ModelDescription
from model.parameters import Parameter
from model.reporting.model_file import dielectric_entry, model_text
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
        limits.highest_within_v(each.protected.worst_case)
        for limits, each in zip(allowed, (first, after), strict=True)
    )
    assert (after_v <= before_v).all()
    assert after.surface.content_hash == refitted.content_hash


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
    highest_v = limits.highest_within_v(settings.protected.worst_case)
    published_v = limits.highest_within_v(build_surface(load_model("reference"), limits).worst_case)
    assert (highest_v > 1.1 * published_v).any() == bool(signs)
