"""The page about the carrier: its policies are those there are, its costs are computed."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from haptic_driver.cli.main import main
from haptic_driver.lookup.build import build_surface
from haptic_driver.lookup.file import ready_for_lookup
from haptic_driver.lookup.models import load_model
from haptic_driver.render.controller import ControllerSettings
from haptic_driver.render.policies import POLICIES, description
from haptic_driver.rig.config import ControllerConfig, load_rig
from haptic_driver.textures.ripple import quiet_reach
from tests.fingers import hiding

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "carrier.md").read_text(encoding="utf-8")


def rows(heading: str) -> list[list[str]]:
    """The cells of the table below a heading, without its head."""
    section = PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    lines = re.findall(r"^\| (.*) \|$", section, flags=re.MULTILINE)
    return [line.split(" | ") for line in lines[1:]]


def test_every_policy_is_described_as_it_describes_itself():
    assert rows("Policies") == [[f"`{name}`", description(name)] for name in POLICIES]


def test_the_default_is_said():
    settings = ControllerConfig()
    assert f"`{settings.policy}` is the default" in PAGE
    assert f"**{settings.quiet_above_hz / 1e3:g} kHz**" in PAGE


@pytest.mark.parametrize("row", rows("What `quiet` costs"), ids=lambda row: row[0])
def test_what_quiet_costs_is_what_the_program_says(row):
    words, any_carrier, quiet, left = row
    config = load_rig(re.findall(r"`(.+)`", words)[0])
    limits, model = config.operating_limits(), load_model("reference")
    if in_the_lead := re.findall(r"(\d+) kΩ", words):
        resistance_ohm = 1e3 * float(in_the_lead[0])
        limits = replace(limits, series_resistance_ohm=resistance_ohm)
        model = hiding(model, series_resistance={"resistance_ohm": resistance_ohm})
    lookup = ready_for_lookup(build_surface(model, limits), limits)
    own = config.controller.model_dump()
    found = quiet_reach(ControllerSettings(lookup, limits, **own), 0.5)
    assert any_carrier == "{:.3f} to {:.3f}".format(*found.any_cof)
    assert quiet == "{:.3f} to {:.3f}".format(*found.cof)
    assert left == f"{100.0 * found.share:.1f} %"


def test_the_ripple_under_linen_is_stronger_than_the_texture(capsys):
    assert "haptic texture check linen --speed 0.05" in PAGE
    assert main(["texture", "check", "linen", "--speed", "0.05", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    asked = [band["asked_cof_rms"] * band["finger_gain"] for band in said["bands"]]
    assert said["ripple"]["cof_rms"] * said["ripple"]["finger_gain"] > max(asked)


def test_every_shipped_rig_has_its_row():
    shipped = {path.stem for path in (ROOT / "configs" / "rigs").glob("*.toml")} - {"template"}
    assert {re.findall(r"`(.+)`", row[0])[0] for row in rows("What `quiet` costs")} == shipped
