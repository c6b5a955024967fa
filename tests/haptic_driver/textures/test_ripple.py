"""The carrier's ripple: where it lies among the bands, whether it is felt, and what quiet costs."""

import pytest

from haptic_driver.limits import OperatingLimits
from haptic_driver.render.controller import ControllerSettings
from haptic_driver.textures.ripple import quiet_reach, ripple

WIDE = OperatingLimits(1e3, 1e-3, 1e7, contact_current_a_rms=((1.0, 1.0),))


@pytest.mark.parametrize(
    ("carrier_hz", "place", "low_hz"),
    [
        (6.2, "below", None),
        (6.25, "in", 12.5),
        (99.9, "in", 126.0),
        (399.0, "in", 504.0),
        (400.0, "above", None),
    ],
)
def test_it_lies_in_the_band_that_begins_at_or_below_it(carrier_hz, place, low_hz):
    """Bands begin at 12.5, 19.8, 31.5, 50, 79.4, 126, 200, 317 and 504 Hz, and end at 800 Hz."""
    found = ripple(carrier_hz, 1000.0)
    assert found.place == place
    if low_hz is None:
        assert found.band_hz is None
        assert f"{place} the bands" in str(found)
    else:
        assert found.band_hz == pytest.approx((low_hz, low_hz * 2.0 ** (2.0 / 3.0)), rel=2e-3)
        assert f"in the band of {low_hz:.3g} to" in str(found)


@pytest.mark.parametrize(
    ("carrier_hz", "quiet_above_hz", "felt"),
    [(499.0, 1000.0, True), (500.0, 1000.0, False), (500.0, 1001.0, True)],
)
def test_it_is_felt_below_the_frequency_that_is_set(carrier_hz, quiet_above_hz, felt):
    found = ripple(carrier_hz, quiet_above_hz)
    assert found.felt is felt
    assert str(found).endswith(": felt" if felt else ": not felt")


@pytest.mark.parametrize("policy", ["min_current", "carrier", "fixed_frequency"])
def test_what_quiet_costs_does_not_depend_on_the_policy(surface, brute_force, grid, policy):
    settings = ControllerSettings(surface, WIDE, policy, 200.0)
    found = quiet_reach(settings, 0.2)
    high = brute_force(0.2, 0.6).cof_high
    quiet = high[grid.frequency_hz >= 500.0 * (1.0 - 1e-9)].max()
    assert found.cof == pytest.approx((0.512, quiet), abs=1e-9)
    assert found.any_cof[1] == pytest.approx(high[grid.frequency_hz >= 100.0].max(), abs=1e-9)
    assert found.share == pytest.approx((found.cof[1] - 0.512) / (found.any_cof[1] - 0.512))
    assert 0.0 < found.share < 1.0


@pytest.mark.parametrize(("quiet_above_hz", "share"), [(150.0, 1.0), (3e6, 0.0)])
def test_it_costs_nothing_or_all_where_all_or_none_are_quiet(surface, quiet_above_hz, share):
    """Carriers go from 100 Hz, whose ripple is at 200 Hz, to the surface's end at 1 MHz."""
    settings = ControllerSettings(surface, WIDE, quiet_above_hz=quiet_above_hz)
    assert quiet_reach(settings, 0.5).share == pytest.approx(share)
