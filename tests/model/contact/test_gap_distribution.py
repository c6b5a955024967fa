import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.contact.gap_distribution import area_ratio, gap_distribution, mean_gap
from model.contact.roughness import SelfAffineShape

FINGERS = ("reference", "table1")
U = np.exp(np.arange(np.log(1e-12), np.log(60.0), 0.02))  # gaps in h_rms; d u = u 0.02


@pytest.fixture
def shape_and_scales(models, scales_of):
    def of(name: str):
        return models[name].table.shape, scales_of(models[name])

    return of


def integral_of_density(distribution, power: int = 0) -> float:
    return float(np.sum(distribution.density(U) * U ** (power + 1)) * 0.02)


@pytest.mark.parametrize("name", FINGERS)
def test_area_and_mean_gap_against_reference(shape_and_scales, reference, name):
    shape, scales = shape_and_scales(name)
    contact = reference[name]["contact"]
    p_hat = contact["pressure_pa"] / scales.pressure_pa
    np.testing.assert_allclose(
        area_ratio(shape, p_hat), contact["area_ratio"], rtol=2e-3
    )  # reference: 0.05 %
    gap = [mean_gap(shape, p) * scales.length_m for p in p_hat]
    np.testing.assert_allclose(gap, contact["mean_gap_m"], rtol=2e-3)


@pytest.mark.parametrize("name", FINGERS)
@pytest.mark.parametrize("pressure_pa", [1e3, 5e3, 3e4, 1e5])
def test_gaps_fill_all_the_area_that_is_not_in_contact(shape_and_scales, name, pressure_pa):
    shape, scales = shape_and_scales(name)
    d = gap_distribution(shape, pressure_pa / scales.pressure_pa)
    # 2e-4 is asked of the theory; a grid that misses zeta -> 1 loses nearly all of it
    assert integral_of_density(d) == pytest.approx(1.0 - d.area_ratio, abs=2e-4)
    assert d.weight.sum() == pytest.approx(
        1.0 - d.area_ratio, abs=1e-6
    )  # rule and cut at erfc(6.5)


@pytest.mark.parametrize("name", FINGERS)
def test_mean_of_the_distribution_is_the_mean_separation(shape_and_scales, name):
    """(48) and (45) are two roads to the mean gap; the theory joins them to about 1 % only."""
    shape, scales = shape_and_scales(name)
    d = gap_distribution(shape, 5e3 / scales.pressure_pa)
    assert integral_of_density(d, power=1) == pytest.approx(d.mean_gap, rel=1e-2)


@pytest.mark.parametrize("name", FINGERS)
def test_mean_separation_against_the_printed_equations(
    models, shape_and_scales, printed_theory, name
):
    shape, scales = shape_and_scales(name)
    theory = printed_theory(models[name])
    for pressure_pa in (2e3, 2e4, 2e5):
        slow = theory.at_zeta_one(pressure_pa)
        # both rules have converged: 1e-9; the spline of the inner integral is good to that
        assert mean_gap(shape, pressure_pa / scales.pressure_pa) * scales.length_m == pytest.approx(
            slow, rel=1e-9
        )


shapes = st.builds(
    SelfAffineShape,
    st.floats(0.3, 0.95),
    st.floats(np.log(50.0), np.log(1e8)).map(np.exp),
    st.floats(0.2, 1.0),
)
pressures = st.floats(np.log(1e-5), np.log(1.0)).map(np.exp)


@given(shapes, pressures)
@settings(max_examples=25)
def test_any_shape_keeps_its_area(shape, p_hat):
    d = gap_distribution(shape, p_hat)
    assert integral_of_density(d) == pytest.approx(1.0 - d.area_ratio, abs=2e-4)
    assert (d.weight >= 0.0).all()
    assert (d.density(U) >= 0.0).all()


@given(shapes, pressures, st.floats(1.01, 3.0))
@settings(max_examples=25)
def test_pressing_harder_closes_the_gap_and_enlarges_the_contact(shape, p_hat, factor):
    assert mean_gap(shape, factor * p_hat) < mean_gap(shape, p_hat)
    assert area_ratio(shape, factor * p_hat) > area_ratio(shape, p_hat)


def test_light_contact_area_is_proportional_to_pressure():
    """A/A0 -> (2/sqrt(pi)) p/(2 sqrt G), the known limit of (42)."""
    shape = SelfAffineShape(0.8, 1e6, 0.45)
    p_hat = 1e-3
    moment = (1e6**0.4 - 1.0) / 0.4
    expected = 2.0 / np.sqrt(np.pi) * p_hat / np.sqrt(0.8 * moment)
    assert float(area_ratio(shape, p_hat)) == pytest.approx(
        expected, rel=1e-8
    )  # next term: (p/2 sqrt G)^2/3 = 1e-9


def test_a_contact_pressed_flat_has_no_gap():
    shape = SelfAffineShape(0.8, 10.0, 0.45)
    assert mean_gap(shape, 100.0) == 0.0
    assert float(area_ratio(shape, 100.0)) == 1.0  # erf(100/...) is 1 in doubles


def test_far_gaps_form_a_tail_and_no_bump():
    """Beyond five h_rms at 100 kPa: what looks like a bump at the step of the integrals is one hill
    per step.
    """
    shape, p_hat = SelfAffineShape(0.71, 1e7, 0.45), 0.375
    far = np.linspace(5.5, 9.0, 60)
    coarse, fine = (gap_distribution(shape, p_hat, step) for step in (0.1, 0.02))
    assert (np.diff(coarse.density(far)) > 0.0).any()
    assert (np.diff(fine.density(far)) < 0.0).all()
    assert fine.weight[fine.separation > 5.0].sum() == pytest.approx(3.07e-4, rel=0.02)
