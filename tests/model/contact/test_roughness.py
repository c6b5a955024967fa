import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from model.contact.roughness import SelfAffineShape, contact_length_m, r_of_hurst

hursts = st.floats(0.2, 0.98)
zeta1s = st.floats(np.log(2.0), np.log(1e9)).map(np.exp)


@given(st.floats(0.4, 0.98))
def test_r_is_the_integral_40(hurst):
    # x = 1 + t^2 takes the root out of (40); below H = 0.4 the tail of the integral is beyond quad
    integral, _ = quad(
        lambda t: 2.0 * (1.0 + t * t) ** (-0.5 / (1.0 - hurst)),
        0.0,
        np.inf,
        epsabs=0.0,
        epsrel=1e-9,
    )
    assert r_of_hurst(hurst) == pytest.approx(
        0.5 * hurst / (1.0 - hurst) * integral, rel=1e-7
    )  # of the quadrature


def test_contact_length_of_both_shipped_fingers(reference):
    for name in ("reference", "table1"):
        r = reference[name]["roughness"]
        length = contact_length_m(r["H"], r["h_rms"], r["q0"], r["q1"])
        assert length == pytest.approx(
            reference[name]["contact_length_m"], rel=1e-6
        )  # seven digits are stored
    assert contact_length_m(0.71, 20e-6, 1e3, 1e10) == pytest.approx(
        22.096e-6, rel=3e-5
    )  # five digits are printed
    assert contact_length_m(0.86, 22e-6, 8e3, 1e10) == pytest.approx(22.910e-6, rel=3e-5)


@given(hursts, zeta1s, st.floats(0.0, 1.0))
def test_moments_are_the_integrals_of_the_spectrum(hurst, zeta1, fraction):
    shape = SelfAffineShape(hurst, zeta1, 0.45)
    zeta = np.exp(fraction * np.log(zeta1))
    below, _ = quad(lambda y: np.exp((2.0 - 2.0 * hurst) * y), 0.0, np.log(zeta), epsrel=1e-10)
    assert shape.moment3(np.array(zeta)) == pytest.approx(
        below, rel=1e-8, abs=1e-14
    )  # of the quadrature


@given(hursts, st.integers(8, 46))
def test_moment_keeps_its_digits_where_nothing_is_magnified_yet(hurst, bits):
    excess = (
        2.0**-bits
    )  # 1 + excess is exact; the moment there is excess (1 + (1/2 - H) excess + ...)
    moment = SelfAffineShape(hurst, 1e7, 0.45).moment3(np.array(1.0 + excess))
    # next term, rounding
    assert moment == pytest.approx(excess * (1.0 + (0.5 - hurst) * excess), rel=excess**2 + 1e-14)
