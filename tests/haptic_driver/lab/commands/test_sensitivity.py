"""`haptic sensitivity`: bars, a table, and what it refuses."""

from tests.haptic_driver.commands import rows_of, said_by


def test_sensitivity_writes_bars_and_a_table(tmp_path):
    found = said_by("sensitivity", "--out", tmp_path, "--draws", 64, "--frequency", 250)
    assert (tmp_path / "sensitivity.png").read_bytes()[:4] == b"\x89PNG"
    rows = rows_of(tmp_path / "sensitivity.csv")
    assert {row["name"] for row in rows} == {entry["name"] for entry in found["indices"]}
    assert (
        max(rows, key=lambda row: float(row["total"]))["name"] == "skin_modulus_pa"
    )  # 0.62 of the variance


def test_draws_that_are_no_power_of_two(refuses, tmp_path):
    refuses("bad_draws", "sensitivity", "--out", tmp_path, "--draws", 100)
