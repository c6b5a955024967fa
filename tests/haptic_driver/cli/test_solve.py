"""`haptic solve`: the contract of its JSON, what it finds, and how it refuses."""

import re

import numpy as np
import pytest

from haptic_driver.lookup.build import SurfaceAxes, build_surface
from haptic_driver.rig.config import load_rig
from model.conditions import Conditions

KEYS = {
    "frequency_hz",
    "voltage_v",
    "cof",
    "electrostatic_force_n",
    "current_rms_a",
    "policy",
    "reachable_cof",
    "cof_interval",
    "ripple",
    "quiet_reach",
    "notes",
}
POLICIES = ["max_authority", "min_voltage", "min_current", "carrier", "quiet"]


@pytest.fixture
def solve(haptic, surface_path):
    def run(friction, *arguments):
        words = ("solve", "--friction", friction, "--surface", surface_path, "--json")
        done = haptic(*words, *arguments)
        return done.status, done.said

    return run


LOADS_N = [0.2, 0.5, 1.0, 0.5, 1.0]


@pytest.mark.parametrize(("policy", "force"), [*zip(POLICIES, LOADS_N, strict=True)])
def test_the_point_gives_the_target_by_the_model(solve, touch, policy, force):
    status, found = solve(0.514, "--policy", policy, "--normal-force", force)
    assert status == 0
    assert set(found) == KEYS
    assert found["policy"] == policy
    answer = touch.predict(
        Conditions(*(np.array([x]) for x in (found["frequency_hz"], found["voltage_v"], force)))
    )
    assert answer.cof[0] == pytest.approx(0.514, rel=1e-3)  # the inversion's promise
    assert found["cof"] == pytest.approx(0.514, abs=1e-6)
    # linear between nodes 7 % apart in frequency
    assert found["current_rms_a"] == pytest.approx(answer.current_rms_a[0], rel=1e-2)


def test_the_force_is_what_the_friction_law_takes(solve):
    """mu = mu_off (1 + F_e/F_n) with mu_off 0.512: 0.6 at 0.5 N takes 0.0859375 N."""
    _, found = solve(0.60)
    assert found["policy"] == load_rig("simulated").controller.policy
    assert found["cof_interval"] is None
    assert found["electrostatic_force_n"] == pytest.approx((0.60 / 0.512 - 1.0) * 0.5, rel=1e-9)


@pytest.mark.parametrize("target", [0.3, 3.0])
def test_out_of_reach_is_status_2_with_the_range_in_the_hint(solve, target):
    _, reached = solve(0.60)
    status, content = solve(target)
    error = content["error"]
    assert status == 2
    assert error["code"] == "unreachable"
    assert f"{target:g}" in error["message"]
    low, high = map(float, re.findall(r"\d+\.\d+", error["hint"]))
    assert (low, high) == pytest.approx(reached["reachable_cof"], rel=1e-3)  # four digits are shown


@pytest.mark.parametrize(
    ("arguments", "code", "hint"),
    [
        (["--policy", "min_volage"], "bad_policy", "Did you mean 'min_voltage'?"),
        (["--policy", "min_voltage", "--frequency", "250"], "bad_policy", "--frequency auto"),
        (["--normal-force", "5"], "out_of_range", "0.1 to 2 N"),
    ],
)
def test_wrong_arguments(solve, arguments, code, hint):
    status, content = solve(0.6, *arguments)
    assert status == 2
    assert content["error"]["code"] == code
    assert hint in content["error"]["hint"]


def test_the_interval_is_that_of_the_surface(haptic, model_description, limits, tmp_path):
    axes = SurfaceAxes(frequency_count=8, voltage_count=9, normal_force_count=4)
    file = build_surface(model_description, limits, axes, with_interval=True)
    file.write(tmp_path / "s.h5")
    command = ("solve", "--friction", 0.6, "--surface", tmp_path / "s.h5", "--frequency", 200)
    found = haptic(*command, "--json").said
    low, high = found["cof_interval"]
    assert low < 0.6 < high
    f = np.searchsorted(file.frequency_hz, 200.0)  # nodes around the point hold it between them
    v, n = (
        np.searchsorted(a, x)
        for a, x in ((file.voltage_v, found["voltage_v"]), (file.normal_force_n, 0.5))
    )
    for end, at in zip(file.cof_interval, (low, high), strict=True):
        around = end[f - 1 : f + 1, v - 1 : v + 1, n - 1 : n + 1]
        assert around.min() <= at <= around.max()
    assert f"{low:.4g} to {high:.4g}" in haptic(*command).out


def test_without_a_surface_the_model_is_solved(haptic, touch):
    done = haptic("solve", "--friction", 0.7, "--frequency", 137, "--json")
    found = done.said
    answer = touch.predict(Conditions(*(np.array([x]) for x in (137.0, found["voltage_v"], 0.5))))
    assert answer.cof[0] == pytest.approx(0.7, rel=1e-3)


def test_for_a_person(haptic, surface_path):
    done = haptic("solve", "--friction", 0.6, "--surface", surface_path, "--frequency", 250)
    assert done.status == 0
    assert done.out.startswith("250 Hz, ")
    assert "friction 0.6 under 0.5 N" in done.out
    assert "ripple of friction at 500 Hz, in the band of 317 to 504 Hz: felt" in done.out
    assert "without a felt ripple (policy quiet): 0.512 to 0.58" in done.out
    assert done.err == ""


@pytest.mark.parametrize(
    ("model", "friction", "notes"), [("reference", 1.0, 1), ("measured", 0.62, 0)]
)
def test_a_force_that_is_steeper_than_that_of_fingers_is_said(haptic, model, friction, notes):
    """Both points lie above 100 V."""
    words = ("solve", "--friction", friction, "--normal-force", 0.5, "--model", model)
    found = haptic(*words, "--json").said
    assert found["voltage_v"] > 100.0
    assert len(found["notes"]) == notes
    said = haptic(*words).out
    assert " ".join(said.split()).count("is steeper than published fingers") == notes
