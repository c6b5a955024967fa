"""The page about safety: what a hand's fingers and a palm leave of voltage and friction."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from haptic_driver.limits import WorstCase
from haptic_driver.lookup.build import build_surface
from haptic_driver.lookup.file import ready_for_lookup
from haptic_driver.lookup.models import load_model
from haptic_driver.lookup.worst_case import worst_case
from haptic_driver.render.controller import Controller, ControllerSettings
from haptic_driver.rig.config import load_rig

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "safety.md").read_text(encoding="utf-8")
SECTION = PAGE.partition("\n### How much contact\n")[2].partition("\n**The last gate**")[0]
ROWS = [line.split(" | ") for line in re.findall(r"^\| (.*) \|$", SECTION, re.MULTILINE)[1:]]
CARRIERS_HZ = np.array([250.0, 2.5e3, 100e3])


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_what_more_contact_leaves_is_what_the_program_says(row):
    _, area, voltages, reach = row
    rig, model = load_rig("simulated"), load_model("reference")
    touching_area_m2 = 1e-6 * float(re.findall(r"(\d+) mm²", area)[0])
    limits = replace(rig.operating_limits(), touching_area_m2=touching_area_m2)
    file = build_surface(model, limits)
    volts = file.voltage_v
    of_one, per_m2, gain = worst_case(model, CARRIERS_HZ, volts)
    worst = WorstCase.of(CARRIERS_HZ, volts, limits.stuck_current(of_one, per_m2), gain)
    assert voltages == ", ".join(f"{v:.3g} V" for v in limits.highest_within_v(worst))
    own = rig.controller.model_dump()
    found = Controller(ControllerSettings(ready_for_lookup(file, limits), limits, **own))
    assert reach == "{:.3f} to {:.3f}".format(*found.reachable(0.5))


def test_the_table_has_its_rows():
    assert len(ROWS) == 4
