"""What a texture asks of a surface, worked out by hand."""

import math

import numpy as np
import pytest

from haptic_driver.render.texture import FrictionMap, Placed, Profile, Script, Step, Uniform
from haptic_driver.textures.reach import demand

REACH = (0.5, 1.0)
RAMP = Profile(
    [0.0, 0.1], [0.4, 1.4]
)  # over the whole screen: a tenth below reach, four tenths above


def test_shares_of_a_ramp():
    found = demand(RAMP, REACH)
    assert (found.share_below, found.share_above, found.share_nothing) == pytest.approx(
        (0.1, 0.4, 0.0)
    )
    assert (found.cof_low, found.cof_high) == (0.4, 1.4)
    assert found.flags == ("below_reach", "above_reach")


def test_shares_are_of_where_something_is_asked_for():
    found = demand(Profile([0.0, 0.05], [0.4, 1.4]), REACH)
    assert (found.share_below, found.share_above, found.share_nothing) == pytest.approx(
        (0.1, 0.4, 0.5)
    )


@pytest.mark.parametrize("cof", [0.5, 0.7, 1.0])
def test_within_reach_up_to_its_ends(cof):
    found = demand(Uniform(cof), REACH)
    assert (found.share_below, found.share_above, found.flags) == (0.0, 0.0, ())
    assert found.steps_felt == 0.0


def test_steps_felt_are_counted_in_weber_fractions():
    assert demand(Profile([0.0, 0.1], [0.6, 0.6 * 1.11**3]), REACH).steps_felt == pytest.approx(3.0)
    assert demand(Profile([0.0, 0.1], [0.6, 0.66]), REACH).flags == ("too_faint",)


def test_a_texture_beside_the_screen_is_flagged():
    found = demand(Placed(FrictionMap(np.full((2, 2), 0.6), 1e-3, 1e-3), -0.5), REACH)
    assert found.flags == ("nothing_on_screen",)
    assert found.share_nothing == 1.0


def test_script_counts_time():
    script = Script(
        (
            Step(0.0, Uniform(0.45)),
            Step(1.0, Uniform(0.6)),
            Step(3.0, Uniform(1.1)),
            Step(4.0, Uniform(0.6)),
        )
    )
    found = demand(script.started(50.0), REACH)
    assert (found.share_below, found.share_above) == pytest.approx((0.25, 0.25), abs=1e-3)
    assert math.isclose(found.share_nothing, 0.0)
