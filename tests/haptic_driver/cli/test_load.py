"""`haptic load` on the served rig, by its drivers; a rig without a load stage is refused."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest

from haptic_driver.simulation.served import CLEAR_M, FACE_M
from tests.haptic_driver.config_texts import served_rig_text
from tests.haptic_driver.stand_ins import living_rig

pytestmark = pytest.mark.timeout(300)

SECTION = f"""
[load_stage]
kind = "lts150"
resource = "{{load_stage}}"
travel_m = [0.0, 0.15]
higher_presses = true
clear_m = {CLEAR_M}
when_wrong = "retract"
"""


@pytest.fixture
def served(rig_config: Any, touch: Any) -> Any:
    with living_rig(rig_config, touch) as rig:
        yield rig


def said(outcome: Any) -> dict[str, Any]:
    told: dict[str, Any] = json.loads(outcome[1])
    return told


@pytest.fixture
def rig(served: Any, tmp_path: Path) -> str:
    path = tmp_path / "mine.toml"
    path.write_text(served_rig_text(served.endpoints) + SECTION.format(**served.endpoints))
    return str(path)


def test_a_load_is_held_and_the_finger_lifted(haptic: Any, rig: str, served: Any) -> None:
    held = said(haptic("load", "hold", "0.5", "--rig", rig, "--seconds", "2", "--yes", "--json"))
    assert held["mean_load_n"] == pytest.approx(0.5, rel=0.1)
    assert held["depth_m"] > FACE_M
    assert served.load_stage.position_mm < 1e3 * FACE_M
    assert not served.load_stage.moving
    assert not served.generator.output().on


def test_tuning_says_what_to_write_down(haptic: Any, rig: str) -> None:
    """The body's tissue has 630 to 740 N/m at 0.5 N, relaxed and at once."""
    found = said(haptic("load", "tune", "--rig", rig, "--by", 'A "B" C', "--yes", "--json"))
    lines = tomllib.loads(found["toml"])
    assert lines["tuned_by"] == 'A "B" C'
    assert 500.0 < lines["stiffness_n_per_m"] < 1000.0


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["hold", "0.5", "--rig", "simulated", "--yes"], "no_load_stage"),
        (["tune", "--by", " ", "--yes"], "usage"),
        (["hold", "0.5", "--seconds", "-1", "--yes"], "out_of_range"),
    ],
)
def test_what_cannot_be_held_is_refused(haptic: Any, arguments: Any, code: str) -> None:
    assert said(haptic("load", *arguments, "--json"))["error"]["code"] == code


@pytest.mark.parametrize("load", ["0.01", "3.5"])
def test_a_load_beyond_the_limits_moves_nothing(
    haptic: Any, rig: str, served: Any, load: str
) -> None:
    assert said(haptic("load", "hold", load, "--rig", rig, "--yes", "--json"))["error"]["code"] == (
        "bad_load"
    )
    assert served.load_stage.position_mm == 5.0


def test_a_simulated_rig_holds_by_its_file_alone(haptic: Any) -> None:
    """Half a newton on a finger of 1 N at 1.75 mm of which a quarter fades is 1.3 to 1.5 mm deep;
    its skin is at 12 mm.
    """
    held = said(haptic("load", "hold", "0.5", "--seconds", "20", "--json"))
    assert held["mean_load_n"] == pytest.approx(0.5, rel=0.03)
    assert 13e-3 < held["depth_m"] < 13.6e-3
    tuned = said(haptic("load", "tune", "--by", "A", "--json"))
    assert 500.0 < tuned["stiffness_n_per_m"] < 1000.0
