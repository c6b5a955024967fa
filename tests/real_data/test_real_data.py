"""What `make real-data` prints, on made folders; the data themselves are not shipped."""

from __future__ import annotations

import json
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import pytest

from tests.real_data.__main__ import (
    FILES,
    MODEL,
    OVER_TIME,
    PEAK,
    WITH_MONITOR,
    checks,
    main,
    missing,
)


def found(verdict: str, names: tuple[str, ...] = (), highest_hz: float = 0.16) -> Any:
    region = SimpleNamespace(axes=("frequency_hz", "time_s"), high=(highest_hz, 2.65))
    decision = SimpleNamespace(names=names)
    findings = SimpleNamespace(
        verdict=SimpleNamespace(decision=decision), before=SimpleNamespace(regions=(region,))
    )
    return SimpleNamespace(name=verdict, findings=findings)


def held(**others: Any) -> dict[str, bool]:
    given = dict.fromkeys(FILES, found("unexplained")) | others
    return {check.must: check.holds for check in checks(given)}


def test_everything_holds_where_nothing_is_named_and_direct_voltage_comes_first():
    assert all(held().values())


@pytest.mark.parametrize("name", [PEAK, WITH_MONITOR])
def test_a_name_for_peak_friction_does_not_hold(name):
    table = held(**{name: found("effect_found", ("drive_gain_error",))})
    assert [must for must, holds in table.items() if not holds] == [f"{name}: no effect is named"]


def test_another_place_first_and_a_set_that_cannot_be_tested_do_not_hold():
    elsewhere = held(**{OVER_TIME: found("unexplained", highest_hz=1000.0)})
    assert not elsewhere[f"{OVER_TIME}: direct voltage is the first place"]
    untested = SimpleNamespace(name="not_testable", findings=None)
    table = held(**{OVER_TIME: untested})
    assert sum(not holds for holds in table.values()) == 2


DIRECT_FIRST = [{"frequency_hz": [0.16, 0.16]}, {"frequency_hz": [1e3, 1e4]}]


@pytest.mark.parametrize(
    ("peak", "where", "held"),
    [
        ({"verdict": "unknown"}, DIRECT_FIRST, (True, True)),
        ({"verdict": "listed", "effects": ["sweat_film"]}, DIRECT_FIRST[::-1], (True, False)),
        ({"verdict": "named", "effects": ["drive_gain_error"]}, [], (False, False)),
        ({}, [{"voltage_v": [1, 9]}], (False, False)),
    ],
)
def test_answers_are_judged_by_place_and_abstention(
    tmp_path, capsys, monkeypatch, peak, where, held
):
    path = tmp_path / "answers.json"
    path.write_text(json.dumps({FILES[PEAK]: peak, FILES[OVER_TIME]: {"where": where}}))
    given = ["--data", str(tmp_path), "--answers", str(path)]
    monkeypatch.setattr(sys, "argv", ["real_data", *given])
    assert main() == (0 if all(held) else 1)
    said = capsys.readouterr().out.splitlines()
    assert [line.startswith("holds") for line in said] == list(held)


@pytest.mark.process
def test_a_folder_without_the_data_is_told_by_name(tmp_path):
    assert set(missing(tmp_path)) == {MODEL, *FILES.values()}
    command = [sys.executable, "-m", "tests.real_data", "--data", str(tmp_path)]
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    assert said.returncode == 2
    assert MODEL in said.stderr
    assert "docs/real-data.md" in said.stderr
    assert not said.stdout
