import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from model.friction import cof, electrostatic_force_n
from model.parameters import FRICTION_LAWS
from model.touch import Friction

loads = st.floats(0.01, 10.0)
ratios = st.floats(0.0, 0.95)
off = st.floats(0.05, 3.0)


def one(value: float) -> np.ndarray:
    return np.array([value])


def test_values_by_hand():
    assert cof("applied_load", 0.5, one(0.1), one(0.5)) == pytest.approx(
        [0.6], rel=1e-14
    )  # rounding
    assert cof("total_load", 0.5, one(0.1), one(0.5)) == pytest.approx([0.625], rel=1e-14)
    assert electrostatic_force_n("applied_load", 0.5, one(0.6), one(0.5)) == pytest.approx(
        [0.1], rel=1e-14
    )
    assert electrostatic_force_n("total_load", 0.5, one(0.625), one(0.5)) == pytest.approx(
        [0.1], rel=1e-14
    )


def test_a_load_exponent_bends_it_with_the_whole_load():
    """Hertz's 2/3 by hand: 0.5 N and eight times that, of which 3.5 N is attraction; 8 * 8^(-1/3) =
    4.
    """
    hertz = Friction(load_exponent=2.0 / 3.0)
    assert cof("applied_load", 0.1, one(0.0), one(0.5), hertz) == pytest.approx([0.1], rel=1e-14)
    assert cof("applied_load", 0.1, one(3.5), one(0.5), hertz) == pytest.approx([0.4], rel=1e-14)
    assert cof("applied_load", 0.1, one(0.0), one(4.0), hertz) == pytest.approx([0.05], rel=1e-14)


@pytest.mark.parametrize("law", FRICTION_LAWS)
@given(mu=off, load=loads, ratio=ratios)
def test_inverse_gives_the_force_back(law, mu, load, ratio):
    back = electrostatic_force_n(law, mu, cof(law, mu, one(ratio * load), one(load)), one(load))
    assert back == pytest.approx(
        [ratio * load], rel=1e-12, abs=1e-14 * load
    )  # 1 - 1/(1/(1 - r)): rounding near r = 0


@pytest.mark.parametrize("force_n", [0.5, 0.6, 100.0, np.inf])
def test_total_load_diverges_where_attraction_reaches_the_load(force_n):
    assert np.isnan(cof("total_load", 0.5, one(force_n), one(0.5)))[0]
    assert cof("total_load", 0.5, one(0.5 - 1e-9), one(0.5))[0] > 1e8
