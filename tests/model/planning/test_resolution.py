"""What a plan could tell apart, held against what must be so whatever the effects are."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_driver.errors import HapticError
from haptic_driver.lab.measuring.plan import Plan, Setting
from haptic_driver.lab.measuring.resolving import ways
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import load_rig
from model.diagnosis.data import Measurements
from model.effects import BY_NAME
from model.planning.resolution import resolution
from model.touch_model import TouchModel

SETTINGS = tuple(
    Setting(f, v, 0.5, 0.02) for f in (20.0, 100.0, 250.0) for v in (50.0, 75.0, 110.0)
)
FEW = (
    "series_resistance",
    "amplifier_slew_limit",
    "johnsen_rahbek",
    "humid_gap_conduction",
    "sweat_film",
    "capillary_adhesion",
    "load_dependent_friction",
)
PLAN = Plan(name="small", settings=(*SETTINGS, Setting(0.0, 0.0, 0.5, 0.02)), repeats=2)


def sets(cof_std: float) -> dict[str, Measurements]:
    found, refusals = ways(
        load_rig("simulated"), TouchModel(load_model("reference")), PLAN, cof_std
    )
    assert refusals == []
    return found


@pytest.fixture(scope="module", autouse=True)
def few():
    """Every two are compared: some of the catalogue, from every stage, stand for it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "model.planning.resolution.testable_effects",
            lambda data, on: [BY_NAME[name] for name in FEW],
        )
        yield


@pytest.fixture(scope="module")
def by_way():
    return {name: resolution(load_model("reference"), data) for name, data in sets(0.01).items()}


def test_a_plan_of_which_nothing_may_be_measured_is_refused():
    beyond = PLAN.model_copy(update={"settings": (Setting(100.0, 1e4, 0.5, 0.02),)})
    with pytest.raises(HapticError) as refused:
        ways(load_rig("simulated"), TouchModel(load_model("reference")), beyond, 0.01)
    assert refused.value.code == "bad_plan"


def test_no_rival_leaves_more_than_no_effect_at_all(by_way):
    """Each can be so weak that it is none."""
    for told in by_way.values():
        for i in range(len(told.names)):
            rivals = told.separation[i, :-1][np.isfinite(told.separation[i, :-1])]
            assert (rivals <= told.visible(i) * (1.0 + 1e-6) + 1e-6).all()


def test_what_acts_in_the_lead_is_seen_in_its_current(by_way):
    """`electrical.md`: friction cannot tell a resistance of 100 kOhm; phase at some kHz can,
    slewing takes more yet.
    """
    friction, card, full = (
        by_way[name] for name in ("as it is", "current by a card", "full sweep")
    )
    resistance = friction.names.index("series_resistance")
    assert "none" in friction.alike(resistance)
    assert card.alike(card.names.index("series_resistance")) == []
    slew = full.names.index("amplifier_slew_limit")
    assert "none" in card.alike(slew)
    assert full.alike(slew) == []


def test_less_noise_tells_more_and_a_stronger_effect_is_plainer(by_way):
    data = sets(0.04)["as it is"]
    usual, strong = (resolution(load_model("reference"), data, strength) for strength in (0.0, 1.0))
    for name in ("humid_gap_conduction", "johnsen_rahbek"):
        at = usual.names.index(name)
        assert by_way["as it is"].visible(at) > usual.visible(at)
        assert strong.visible(at) > usual.visible(at)
