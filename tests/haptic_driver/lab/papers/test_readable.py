"""How a data sheet says a number: its unit, and as many digits as its interval deserves."""

import pytest

from haptic_driver.lab.papers.data_sheet import readable


@pytest.mark.parametrize(
    ("name", "unit", "numbers", "value", "interval"),
    [
        ("bandwidth", "Hz", (145.07, 140.2, 149.4), "145 Hz", "140 to 149"),
        ("levels", "", (10.278, 10.255, 10.301), "10.28", "10.26 to 10.30"),
        ("latency", "s", (0.437e-3, 0.368e-3, 0.507e-3), "0.437 ms", "0.368 to 0.507"),
        ("position_error", "m", (8.749e-6, 7.36e-6, 10.1e-6), "8.7 µm", "7.4 to 10.1"),
        ("within_touches", "", (0.000911, 0.00073, 0.00121), "0.091 %", "0.073 to 0.121"),
        ("between_touches", "", (0.0, 0.0, 0.000592), "0 %", "0 to 0.0592"),
        ("stuck_current", "A rms", (0.48065e-3, None, None), "0.481 mA rms", "-"),
        ("noise", "N", (None, None, None), "not known", "-"),
    ],
)
def test_a_number_has_its_unit_and_digits(name, unit, numbers, value, interval):
    one = dict(zip(("value", "low", "high"), numbers, strict=True)) | {"unit": unit}
    assert readable(name, one) == (value, interval)
