"""Numbers as people read them."""

from __future__ import annotations

import pytest

from haptic_driver.base.units import readable


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (3.84e-5, "38.4 µA"),
        (-2.0, "-2 A"),
        (0.9996, "1 A"),
        (9.996e-4, "1 mA"),
        (3.7e8, "370 MA"),
        (1e13, "1e+04 GA"),
        (0.0, "0 A"),
        (float("inf"), "inf A"),
    ],
)
def test_a_number_has_three_digits_and_a_prefix(value, said):
    assert readable(value, "A") == said
