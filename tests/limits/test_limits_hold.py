"""100 of the draws of `make limits`, on a coarser surface, where cells are larger and everything
bends more in them.
"""

import numpy as np
import pytest

from haptic_driver.lookup.models import load_model
from tests.limits.draws import drawn, shares

DRAWS, PARTS = 100, 4
ROUNDING = 1e-9


@pytest.mark.parametrize("part", range(PARTS))
def test_nothing_that_goes_out_exceeds_a_limit_by_the_full_model(part):
    """Set points and the carriers of envelopes, under any load, sliding, resting and stuck.

    A stuck current once was 6.6 times its limit, an electrode's voltage 6 times, an open modulation
    input 4.4 times.
    """
    reference, went_out = load_model("reference"), 0
    for k in range(part, DRAWS, PARTS):
        draw = drawn(reference, np.random.default_rng([1, k]), coarse=True)
        if draw is None:
            continue
        assert not draw.refused, (k, draw.refused[0], draw.about)
        went_out += len(draw.points)
        for voltages_v in ([point.voltage_v for point in draw.points], draw.full_scale_v):
            for limit, taken in shares(draw, voltages_v)._asdict().items():
                assert np.max(taken) <= 1.0 + ROUNDING, (
                    k,
                    limit,
                    draw.points[int(np.argmax(taken))],
                    draw.about,
                )
    assert went_out > DRAWS / PARTS
