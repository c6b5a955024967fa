"""`haptic demo`: the contract of its JSON, and what it says of a trace, a texture or a rig it
cannot use.
"""

import re

import matplotlib.image
import pytest

from haptic_driver.cli.demo import _of_gain
from tests.haptic_driver.config_texts import SIMULATED, changed

CONTRACT = {
    "share_within_5_percent",
    "cof_error_rms",
    "contact_time_s",
    "reachable_share",
    "max_voltage_v",
    "output_on_without_contact_s",
    "pictures",
    "constant_share_within_5_percent",
    "band_gain",
    "band_coherence",
}


@pytest.fixture
def demo(haptic, surface_path, tmp_path):
    def run(*arguments):
        return haptic("demo", "--surface", surface_path, "--out", tmp_path / "out", *arguments)

    return run


def trace(tmp_path, force_n=0.5, duration_s=0.6, extra=()):
    path = tmp_path / "trace.csv"
    lines = [f"{0.01 * i:.2f},{4e-4 * i:.6f},{force_n}" for i in range(int(duration_s / 0.01))]
    path.write_text("\n".join(["time_s,position_m,normal_force_n", *lines, *extra]) + "\n")
    return path


def test_the_main_job(demo):
    said = demo("--json").said
    assert set(said) >= CONTRACT
    # 0.951 where speed was smoothed by 10 ms: the first 29 ms of sliding, in which friction and
    # output have yet to come up, did not count as sliding then
    assert said["share_within_5_percent"] >= 0.93
    assert said["reachable_share"] == 1.0
    assert len(said["band_gain"]) == len(said["band_coherence"]) == 9
    assert said["constant_share_within_5_percent"] < 0.6  # a grating of 0.6 to 0.8
    assert said["output_on_without_contact_s"] < 0.1  # set points take 40 ms to fall, twice
    assert 50.0 < said["max_voltage_v"] <= 150.0
    assert 4.0 < said["contact_time_s"] < 6.4
    assert 0.0 < said["cof_error_rms"] < 0.05  # 0.033 without those 29 ms
    assert said["simulated"] is True
    assert said["pictures"]
    for picture in said["pictures"]:
        assert matplotlib.image.imread(picture)[..., :3].std() > 0.01


def test_no_contact_is_no_result_and_no_warning(demo, tmp_path):
    done = demo("--json", "--trace", trace(tmp_path, 0.05))
    assert (done.status, done.err) == (0, "")
    said = done.said
    assert said["share_within_5_percent"] is None
    assert said["contact_time_s"] == 0.0
    assert said["max_voltage_v"] <= 1.001  # the lowest of a 33220A


def test_for_a_person(demo, tmp_path):
    done = demo("--trace", trace(tmp_path))
    assert (done.status, done.err) == (0, "")
    for words in (
        "on a simulated rig",
        "within 5 % for",
        "a constant",
        "refused by the safety gate 0",
        "generator says off, amplifier disabled",
    ):
        assert words in done.out
    assert "--no-feedback" not in done.out


@pytest.mark.parametrize("words", [[], ["--no-feedback"]])
def test_what_feedback_has_closed_is_told_with_the_gain_that_it_found(demo, tmp_path, words):
    hidden = SIMULATED + "\n[simulation.hide.drive_gain_error]\ngain = 0.8\n"
    (tmp_path / "rig.toml").write_text(hidden, encoding="utf-8")
    told = re.findall(
        r"friction is (\S+) times .* feedback closes what is missing; --no-feedback shows it",
        demo("--rig", tmp_path / "rig.toml", "--trace", trace(tmp_path), *words).out,
    )
    # attraction goes with the square of the voltage, and is some 40 % of friction here
    assert [0.7 < float(gain) < 0.95 for gain in told] == ([] if words else [True])


def test_feedback_is_not_said_to_close_what_the_finger_does_not_reach():
    """Where 8 % of the time was within reach the demo said all the same that feedback closes it."""
    assert "no feedback closes that" in _of_gain(0.42, 0.08)
    for reachable_share in (0.9, None):
        assert "feedback closes what is missing" in _of_gain(0.8, reachable_share)


def test_a_force_that_the_model_cannot_take_is_about_the_trace(demo, tmp_path):
    """3000 N on a fingertip: said of the trace, and not of a row of something that the user never
    wrote.
    """
    path = trace(tmp_path, force_n=3000)
    done = demo("--trace", path, "--json")
    assert done.status == 2
    assert str(path) in done.said["error"]["message"]


def test_a_rig_that_names_its_finger_may_have_any_surface(haptic, refuses, small_file, tmp_path):
    """As after a diagnosis: the surface of the model that was found, under the finger as it is."""
    named = changed(SIMULATED, ("[simulation]\n", '[simulation]\nmodel = "table1"\n'))
    (tmp_path / "named.toml").write_text(named, encoding="utf-8")
    small_file.write(tmp_path / "surface.h5")  # of model reference
    files = ("--rig", tmp_path / "named.toml", "--surface", tmp_path / "surface.h5")
    command = ("demo", *files, "--trace", trace(tmp_path), "--out", tmp_path / "out")
    assert haptic(*command).status == 0
    error = refuses("other_model", *command, "--model", "table1")
    assert "built from model 'reference', which is not model 'table1'" in error["message"]
    assert "--model" in error["hint"]


def test_targets_out_of_reach_are_said_with_the_reach_and_no_empty_table(haptic, tmp_path):
    rig = tmp_path / "weak.toml"
    rig.write_text(changed(SIMULATED, ("voltage_v = 150.0", "voltage_v = 20.0")))
    done = haptic("demo", "--rig", rig, "--trace", trace(tmp_path), "--out", tmp_path / "out")
    assert "targets are 0.600 to 0.800, and the nearest that this" in done.out
    assert "its limits are too low for them" in done.out
    assert "target ┃" not in done.out


def test_a_finger_that_never_slides_is_told_without_a_table(demo, tmp_path):
    assert "nothing was asked for" in demo("--trace", trace(tmp_path, force_n=0.01)).out
