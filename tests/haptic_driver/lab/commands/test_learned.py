"""Commands with a model that has learned a term: they keep to its range, and say so."""

import json
from pathlib import Path

import pytest

SHIPPED = Path(__file__).parents[4] / "configs" / "models" / "reference.toml"
TABLE = """
[effects.learned]
acts_on = "friction"
shape = "spline"
lowest_voltage_v = 40.0
with_phase = false
terms = [{ frequency_hz = [20.0, 200.0, 2000.0], voltage_v = [40.0, 90.0] }]
"""
VALUES = [f"frequency_hz_{i}_voltage_v_{j} = 0.1" for i in range(3) for j in range(2)]


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "learned.toml"
    path.write_text(
        "\n".join([SHIPPED.read_text(encoding="utf-8"), TABLE, *VALUES, ""]), encoding="utf-8"
    )
    return path


def test_a_surface_ends_where_the_learned_effect_does(haptic, model, tmp_path):
    small = ("--frequency-count", 8, "--voltage-count", 4, "--force-count", 4, "--no-interval")
    built = haptic(
        "surface", "build", "--model", model, "--out", tmp_path / "s.h5", *small, "--json"
    )
    assert built.status == 0
    axes = json.loads(built.out)["axes"]
    assert (axes["frequency_hz"]["low"], axes["frequency_hz"]["high"]) == pytest.approx(
        (20.0, 2000.0)
    )
    assert axes["voltage_v"]["high"] == pytest.approx(90.0)
    assert "ends where effect learned" in built.err

    refused = haptic(
        "surface",
        "build",
        "--model",
        model,
        "--out",
        tmp_path / "t.h5",
        *small,
        "--voltage-high-v",
        120,
    )
    assert refused.status == 2
    assert "learned from 0 to 90" in refused.err
    assert not (tmp_path / "t.h5").exists()


@pytest.mark.parametrize(
    ("row", "words"), [("5,80,0.5", "frequency_hz"), ("100,99,0.5", "voltage_v")]
)
def test_predictions_outside_its_range_are_refused(haptic, model, tmp_path, row, words):
    table = tmp_path / "t.csv"
    table.write_text(f"frequency_hz,voltage_v,normal_force_n\n100,80,0.5\n0,0,0.5\n{row}\n")
    refused = haptic("predict", "--model", model, "--table", table, "--out", tmp_path / "o.csv")
    assert refused.status == 2
    assert f"effect learned knows nothing at {words}" in refused.err
    table.write_text("frequency_hz,voltage_v,normal_force_n\n100,80,0.5\n0,0,0.5\n")
    assert (
        haptic("predict", "--model", model, "--table", table, "--out", tmp_path / "o.csv").status
        == 0
    )
