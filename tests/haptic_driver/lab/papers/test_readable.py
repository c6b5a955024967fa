"""How a data sheet says a number: its unit, and as many digits as its interval deserves."""

import pytest

from haptic_driver.lab.papers.data_sheet import readable


@pytest.mark.parametrize(
    ("name", "unit", "numbers", "value", "interval"),
    [
        ("levels", "", (10.278, 10.255, 10.301), "10.28", "10.26 to 10.30"),
        ("position_error", "m", (8.749e-6, 7.36e-6, 10.1e-6), "8.7 µm", "7.4 to 10.1"),
        ("between_touches", "", (0.0, 0.0, 0.000592), "0 %", "0 to 0.0592"),
        ("stuck_current", "A rms", (0.48065e-3, None, None), "0.481 mA rms", "-"),
        ("noise", "N", (None, None, None), "not known", "-"),
    ],
)
def test_a_number_has_its_unit_and_digits(name, unit, numbers, value, interval):
    one = dict(zip(("value", "low", "high"), numbers, strict=True)) | {"unit": unit}
    assert readable(name, one) == (value, interval)
