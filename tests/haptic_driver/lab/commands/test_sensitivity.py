"""`haptic sensitivity`: bars, a table, and what it refuses."""

from tests.haptic_driver.commands import rows_of


def test_sensitivity_writes_bars_and_a_table(haptic, tmp_path):
    done = haptic("sensitivity", "--out", tmp_path, "--draws", 64, "--frequency", 250, "--json")
    assert done.status == 0, done.err
    found = done.said
    assert (tmp_path / "sensitivity.png").read_bytes()[:4] == b"\x89PNG"
    rows = rows_of(tmp_path / "sensitivity.csv")
    assert {row["name"] for row in rows} == {entry["name"] for entry in found["indices"]}
    assert (
        max(rows, key=lambda row: float(row["total"]))["name"] == "skin_modulus_pa"
    )  # 0.62 of the variance


def test_draws_that_are_no_power_of_two(haptic, tmp_path):
    done = haptic("sensitivity", "--out", tmp_path, "--draws", 100, "--json")
    assert done.status == 2
    assert done.said["error"]["code"] == "bad_draws"
