import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from model.electric.dielectrics import (
    EPS0,
    GABRIEL_DRY,
    GABRIEL_WET,
    ColeCole,
    PowerLaw,
    Tabulated,
    read_csv,
    total_conductivity_s_per_m,
)
from model.support.errors import ModelError

frequencies = st.floats(-2.0, 9.0).map(lambda exponent: 10.0**exponent)
HEADER = "frequency_hz,eps_real,conductivity_s_per_m\n"


def at(dielectric, frequency_hz: float) -> complex:
    return complex(dielectric.permittivity(np.array([frequency_hz]))[0])


@pytest.mark.parametrize("dielectric", [GABRIEL_DRY, GABRIEL_WET], ids=lambda d: d.name)
def test_sets_against_reference(reference, dielectric):
    r = reference["skin"][dielectric.name]
    k = dielectric.permittivity(r["frequency_hz"])
    np.testing.assert_allclose(k.real, r["eps_real"], rtol=1e-6)  # seven digits are stored
    sigma = total_conductivity_s_per_m(k, r["frequency_hz"])
    np.testing.assert_allclose(sigma, r["conductivity_s_per_m"], rtol=1e-6)


def test_one_debye_term_in_closed_form():
    debye = ColeCole("debye", "test", 3.0, ((10.0, 1e-6, 0.0),), 1e-3)
    f = 1.0 / (2.0 * np.pi * 1e-6)  # w tau = 1: D/(1 + j) = D/2 - j D/2
    k = at(debye, f)
    assert k.real == pytest.approx(8.0, rel=1e-12)  # rounding
    assert k.imag == pytest.approx(-5.0 - 1e-3 / (1e6 * EPS0), rel=1e-12)


@pytest.mark.parametrize(
    "dielectric", [GABRIEL_DRY, GABRIEL_WET, PowerLaw(4.0, 1e3, 0.3, 2e-4)], ids=lambda d: d.name
)
@given(f=frequencies)
def test_every_set_is_passive_and_disperses_downwards(dielectric, f):
    k, later = at(dielectric, f), at(dielectric, 1.5 * f)
    assert k.imag < 0.0
    assert later.real <= k.real * (1.0 + 1e-12)  # rounding
    sigma, sigma_later = (
        total_conductivity_s_per_m(np.array(v), g) for v, g in ((k, f), (later, 1.5 * f))
    )
    assert sigma_later >= sigma * (1.0 - 1e-12)


def test_power_law_at_its_own_frequency():
    k = at(PowerLaw(5.0, 800.0, 0.25, 0.0), 250.0)
    turned = 800.0 * (np.cos(np.pi / 8.0) - 1j * np.sin(np.pi / 8.0))  # j^(-1/4)
    assert k == pytest.approx(5.0 + turned, rel=1e-12)  # rounding
    assert "surrogate" in PowerLaw(5.0, 800.0, 0.25, 0.0).source


class TestTable:
    def write(self, folder, text: str):
        path = folder / "own.csv"
        path.write_text(text, encoding="utf-8")
        return path

    def test_nodes_are_given_back_and_between_them_is_a_power_law(self, tmp_path):
        table = read_csv(self.write(tmp_path, HEADER + "10,2000,1e-4\n1000,500,4e-4\n"))
        assert table.name == "own"
        assert "own.csv" in table.source
        for f, eps, sigma in ((10.0, 2000.0, 1e-4), (100.0, 1000.0, 2e-4), (1000.0, 500.0, 4e-4)):
            k = at(table, f)
            assert k.real == pytest.approx(eps, rel=1e-12)  # rounding
            assert -k.imag * 2.0 * np.pi * f * EPS0 == pytest.approx(sigma, rel=1e-12)

    def test_ends_are_held(self):
        table = Tabulated("t", "test", (10.0, 1000.0), (2000.0, 500.0), (1e-4, 4e-4))
        assert at(table, 1.0).real == pytest.approx(2000.0, rel=1e-12)
        sigma = total_conductivity_s_per_m(np.array(at(table, 1e6)), 1e6)
        assert sigma == pytest.approx(4e-4, rel=1e-12)  # held is the conductivity, not eps''

    @pytest.mark.parametrize(
        ("text", "says"),
        [
            (HEADER + "1,10,1e-4\n2,ten,1e-4\n", "line 3"),
            ("frequency,eps_real,conductivity_s_per_m\n1,10,1e-4\n2,11,1e-4\n", "frequency_hz"),
            (HEADER + "1,10,1e-4\n", "not a usable"),
            (HEADER + "2,10,1e-4\n1,11,1e-4\n", "not a usable"),
            (HEADER + "0,10,1e-4\n1,11,1e-4\n", "not a usable"),
            (HEADER + "1,10,-1e-4\n2,11,1e-4\n", "not a usable"),
            (HEADER + "1,nan,1e-4\n2,11,1e-4\n", "line 2: eps_real is 'nan'"),
        ],
    )
    def test_bad_tables_are_refused(self, tmp_path, text, says):
        path = self.write(tmp_path, text)
        with pytest.raises(ModelError, match=says) as caught:
            read_csv(path)
        assert "own.csv" in caught.value.message
        wanted = "Call it frequency_hz" if says == "frequency_hz" else "frequencies rising"
        assert wanted in caught.value.hint
