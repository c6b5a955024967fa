"""Commands with a model that has learned a term: they keep to its range, and say so."""

import pytest

from tests.fingers import SHIPPED

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
    path.write_text("\n".join([SHIPPED, TABLE, *VALUES, ""]), encoding="utf-8")
    return path


def test_a_surface_ends_where_the_learned_effect_does(haptic, model, tmp_path):
    """Axes beyond are refused: tests/haptic_driver/lookup/test_build.py."""
    small = ("--frequency-count", 8, "--voltage-count", 4, "--force-count", 4, "--no-interval")
    words = ("surface", "build", "--model", model, "--out", tmp_path / "s.h5", *small, "--json")
    built = haptic(*words)
    assert built.status == 0
    axes = built.said["axes"]
    assert axes["frequency_hz"] == pytest.approx({"low": 20.0, "high": 2000.0, "count": 8})
    assert axes["voltage_v"]["high"] == pytest.approx(90.0)
    assert "ends where effect learned" in built.err


def test_predictions_outside_its_range_are_refused(haptic, model, tmp_path):
    table = tmp_path / "t.csv"
    command = ("predict", "--model", model, "--table", table, "--out", tmp_path / "o.csv")
    inside = "frequency_hz,voltage_v,normal_force_n\n100,80,0.5\n0,0,0.5\n"
    for row, name in (("5,80,0.5", "frequency_hz"), ("100,99,0.5", "voltage_v")):
        table.write_text(inside + row)
        refused = haptic(*command)
        assert refused.status == 2
        assert f"effect learned knows nothing at {name}" in refused.err
    table.write_text(inside)
    assert haptic(*command).status == 0
