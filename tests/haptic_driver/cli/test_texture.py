"""`haptic texture list`, `preview` and `check`."""

import matplotlib.image
import pytest


@pytest.fixture
def own_configs(tmp_path, monkeypatch):
    """A folder of textures that is searched before the program's own."""
    folder = tmp_path / "configs" / "textures"
    folder.mkdir(parents=True)
    monkeypatch.setenv("HAPTIC_CONFIGS", str(folder.parent))
    return folder


def test_list_names_all_and_what_they_are(haptic):
    done = haptic("texture", "list", "--json")
    assert done.status == 0
    entries = {entry["name"]: entry for entry in done.said["textures"]}
    assert {"grating", "linen", "steps"} <= set(entries)
    assert entries["grating"]["kind"] == "grating"
    assert entries["grating"]["cof"] == pytest.approx([0.6, 0.8])
    assert all(entry["description"] and entry["error"] is None for entry in entries.values())
    shown = haptic("texture", "list")
    assert shown.status == 0
    assert "sawtooth, 6 mm" in shown.out


def test_list_shows_a_faulty_file_with_its_fault(haptic, own_configs):
    (own_configs / "mine.toml").write_text('kind = "uniform"\ncof = -0.6\n')
    done = haptic("texture", "list", "--json")
    assert done.status == 0
    entries = {entry["name"]: entry for entry in done.said["textures"]}
    assert "cof: " in entries["mine"]["error"]
    assert entries["linen"]["error"] is None


def test_preview_draws(haptic, tmp_path):
    done = haptic("texture", "preview", "linen", "--out", tmp_path / "linen.png", "--json")
    assert done.status == 0
    assert done.said == {"picture": str(tmp_path / "linen.png")}
    assert matplotlib.image.imread(tmp_path / "linen.png").std() > 0.1


def test_check_says_what_is_in_reach(haptic, surface_path):
    """And the carrier's ripple of a grating up to 0.8, over 0.512 without voltage."""
    command = ("texture", "check", "grating", "--surface", surface_path)
    said = haptic(*command, "--json").said
    ripple_hz = said["ripple"]["frequency_hz"]
    assert said["ripple"]["cof_rms"] == pytest.approx((0.8 - 0.512) / 2**0.5, rel=1e-6)
    shown = haptic(*command).out
    assert f"ripple at the highest friction: {ripple_hz:.4g} Hz" in shown
    beyond = "finger: measured up to 0.1 m/s"
    assert beyond not in shown
    assert beyond in haptic(*command, "--speed", "0.15").out
    assert (said["share_below"], said["share_above"], said["flags"]) == (0.0, 0.0, [])
    low, high = said["reachable_cof"]
    assert low < 0.6
    assert high > 0.8


@pytest.mark.parametrize(
    ("rig", "verdict"), [("simulated", "out_of_reach"), ("simulated-envelope", "reached")]
)
def test_check_says_which_band_a_rig_reaches_at_a_speed(haptic, surface_path, rig, verdict):
    """1 mm at 0.1 m/s are 100 Hz: set points every 10 ms bring out 50 Hz at most, an envelope any
    band.
    """
    options = ("--surface", surface_path, "--rig", rig, "--speed", "0.1")
    bands = haptic("texture", "check", "fine_grating", *options, "--json").said["bands"]
    assert len(bands) == 9
    asked = [band for band in bands if band["verdict"] != "nothing_asked"]
    assert [band["verdict"] for band in asked] == [verdict]
    assert asked[0]["low_hz"] < 100.0 < asked[0]["high_hz"]
    assert verdict.replace("_", " ") in haptic("texture", "check", "fine_grating", *options).out


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [("--normal-force 99", "Give 0.1 to 2 N"), ("--speed 50", "Give 0.002 to 1 m/s")],
)
def test_what_no_finger_does_is_refused(haptic, arguments, hint):
    error = haptic("texture", "check", "linen", *arguments.split(), "--json").said["error"]
    assert error["code"] == "out_of_range"
    assert hint in error["hint"]
