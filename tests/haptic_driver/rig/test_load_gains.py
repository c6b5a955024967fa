"""What a load stage's tuning writes down is read back."""

import datetime

import pytest

from haptic_driver.rig.load_gains import LoadGains, read_gains


@pytest.mark.parametrize("who", ["A. Smith", "𠮷田"])
def test_gains_are_read_back_whoever_found_them(tmp_path, who):
    """Once a name beyond the basic plane made the file unreadable."""
    day = datetime.date(2026, 11, 28)
    made = LoadGains(stiffness_n_per_m=812.0, spread_n_per_m=11.0, tuned_by=who, tuned_at=day)
    made.write(tmp_path / "gains.toml")
    assert read_gains(tmp_path / "gains.toml") == made
