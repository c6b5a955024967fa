from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from model.contact.gap_table import GapTable, axis, gap_nodes
from model.contact.resolution import LOG_P_AXIS
from model.contact.roughness import SelfAffineShape
from model.electric.circuit import GapCircuit
from model.electric.dielectrics import EPS0
from model.solver import solve, solve_near

FINGERS = ("reference", "table1")

# A soft and nearly smooth finger on a thin insulator, all numbers within their ranges: its V(p_e)
# turns back.
FOLDING = {
    "hurst_exponent": 0.2,
    "contact_gamma": 1.0,
    "roll_off_wavenumber_per_m": 1e4,
    "cut_off_wavenumber_per_m": 1e7,
    "roughness_rms_m": 1e-5,
    "skin_modulus_pa": 1e5,
    "skin_thickness_m": 1e-6,
    "insulator_thickness_m": 1e-8,
    "insulator_permittivity": 100.0,
    "leak_scale": 0.0,
    "contact_area_m2": 1e-2,
}


@pytest.fixture(scope="module")
def solve_sine(sine_circuit):
    """Electrostatic pressure [n], and what has pulled in."""

    def solved(
        model, frequency_hz: float, voltage_v: np.ndarray, load_pa: float
    ) -> tuple[np.ndarray, np.ndarray]:
        return solve(model.table, sine_circuit(model, frequency_hz, voltage_v, load_pa))

    return solved


@pytest.mark.parametrize("name", FINGERS)
@given(
    f=st.floats(0.0, 6.0).map(lambda e: 10.0**e), v=st.floats(5.0, 150.0), load=st.floats(5e2, 2e4)
)
@settings(max_examples=40)
def test_pressure_satisfies_its_own_loop(models, solve_sine, gain_by_quadrature, name, f, v, load):
    model = models[name]
    p_e = float(solve_sine(model, f, np.array([v]), load)[0][0])
    assert p_e > 0.0
    # 1e-4 is what the table may differ from direct quadrature
    assert p_e == pytest.approx(v * v / 2.0 * gain_by_quadrature(model, f, load + p_e), rel=1e-4)


def test_components_add_their_mean_squares(models, scales_of, stack_of, circuit_of):
    model = models["reference"]
    s, load = stack_of(model, np.array([250.0])), np.array([5e3])
    one, two, three = (np.array([v]) for v in (1000.0, 2000.0, 3000.0))
    whole, _ = solve(model.table, circuit_of(scales_of(model), [(s, three)], load))
    parts, _ = solve(model.table, circuit_of(scales_of(model), [(s, one), (s, two)], load))
    assert parts[0] == pytest.approx(whole[0], rel=1e-8)  # the loop is closed to 1e-10 of the total


class CubicTable:
    """The gain of a made-up table at any log pressure, cubic between its nodes, by numpy alone."""

    def __init__(self, table: GapTable) -> None:
        self.nodes, self.log_k = axis(LOG_P_AXIS), table.values[:, 0, 0, 0]

    def __call__(self, log_p: np.ndarray) -> np.ndarray:
        step = self.nodes[1] - self.nodes[0]
        first = np.clip(((log_p - self.nodes[0]) / step).astype(int) - 1, 0, self.nodes.size - 4)
        x = (log_p - self.nodes[first]) / step
        total = np.zeros_like(log_p)
        for j in range(4):
            weight = np.prod([(x - k) / (j - k) for k in range(4) if k != j], axis=0)
            total += weight * self.log_k[first + j]
        return np.exp(total)


class TestMadeUpContact:
    """Tables made up so that the loop has a solution by hand; z = 1 and no leak, so g(p) = (eps0/2)
    K(p).
    """

    NODES = (85, 121, 15, 3)

    def table(self, log_k: Callable[[np.ndarray], np.ndarray]) -> GapTable:
        values = np.zeros(self.NODES)
        values[..., 0] = log_k(axis(LOG_P_AXIS))[:, None, None]
        mass = np.zeros((self.NODES[0], gap_nodes().size))
        return GapTable(SelfAffineShape(0.7, 1e7, 0.45), values, mass)

    @staticmethod
    def circuit(mean_square: np.ndarray, load: float) -> GapCircuit:
        n = mean_square.size
        one, zero, layers = np.ones(n), np.zeros(n), np.ones((n, 1), complex)
        return GapCircuit(
            pressure_scale_pa=one,
            length_scale_m=one,
            h_m=layers,
            k_gap=layers,
            bypass_per_m=0.0 * layers,
            leak_per_m_pa=0.0 * layers,
            mean_square_v2=mean_square[:, None],
            crest_square=np.full((n, 1), 2.0),
            gap_shift_m=zero,
            load_pa=np.full(n, load),
            added_pa=zero,
            field_limit_v_per_m=np.full(n, np.inf),
        )

    def solve(self, log_k, mean_square: np.ndarray, load: float) -> tuple[np.ndarray, np.ndarray]:
        return solve(self.table(log_k), self.circuit(mean_square, load))

    def test_linear_gain(self):
        """p = p0 + B p: p_e = p0 B/(1 - B); no equilibrium from B = 1 on."""
        b = np.array([0.1, 0.5, 0.9, 1.0, 1.5])
        expected = np.where(b < 1.0, 1e-2 * b / np.where(b < 1.0, 1.0 - b, 1.0), np.nan)
        p_e, pulled_in = self.solve(lambda x: x, b / (0.5 * EPS0), 1e-2)
        # the loop is closed to 1e-10 p, which is 1e-9 of p_e here and ten times that at B = 0.9
        np.testing.assert_allclose(p_e, expected, rtol=1e-7)
        assert not pulled_in.any()  # past the table without ever having turned

    @pytest.mark.parametrize("p", [9.0, 9.9, 9.99])
    def test_an_equilibrium_just_inside_the_table_is_found(self, p):
        """Its last pressure is 10; the way there is in long steps."""
        p0 = 1e-2
        mean_square = np.array([(p - p0) / np.sqrt(p) / (0.5 * EPS0)])
        assert self.solve(lambda x: 0.5 * x, mean_square, p0)[0][0] == pytest.approx(
            p - p0, rel=1e-6
        )

    def test_a_load_at_the_end_of_the_table_has_not_pulled_in(self):
        p_e, pulled_in = self.solve(
            lambda x: 0.5 * x, np.array([1.0 / EPS0]), float(np.exp(LOG_P_AXIS[1]))
        )
        assert np.isnan(p_e[0])
        assert not pulled_in[0]

    def test_quadratic_gain_turns_back(self):
        """p = p0 + B p^2 has two roots below 4 B p0 = 1 and none above; reachable is the lower."""
        p0 = 1e-2
        fraction = np.array([0.01, 0.3, 0.9, 0.99, 1.01, 3.0])  # of B at the turn
        b = fraction / (4.0 * p0)
        lower = np.where(
            fraction < 1.0,
            (1.0 - np.sqrt(np.maximum(1.0 - fraction, 0.0))) / (2.0 * b) - p0,
            np.nan,
        )
        p_e, pulled_in = self.solve(lambda x: 2.0 * x, b / (0.5 * EPS0), p0)
        # at 0.99 of the turn, an error of 1e-10 in the loop is 1e-8 of p_e
        np.testing.assert_allclose(p_e, lower, rtol=1e-6)
        np.testing.assert_array_equal(pulled_in, fraction > 1.0)

    @given(
        slopes=st.tuples(*[st.floats(0.0, 4.0)] * 3),
        bends=st.tuples(st.floats(-6.0, -3.0), st.floats(0.3, 3.0)),
        fraction=st.floats(0.01, 1.5),
    )
    @example(
        slopes=(0.0, 0.0, 1.0), bends=(-3.0, 1.0), fraction=0.99999
    )  # 1,000 steps once ended on the way
    @example(
        slopes=(3.109375, 0.0, 1.0), bends=(-6.0, 1.0), fraction=1.5
    )  # turns back by 4e-4, over 12 % of p
    @settings(max_examples=200)
    def test_the_lowest_equilibrium_is_found_wherever_the_gain_bends(self, slopes, bends, fraction):
        """log gain of three slopes in log p, round at the bends, against a scan of 200,000
        pressures.

        A turn within one step of the solver is shallower than 1e-3 of V^2, which is what a table is
        good for (1e-4 of the gain, 5e-4 of V is the shallowest that a real contact has shown): the
        solver may pass it and find where the contact comes to rest beyond, or call it pulled in.
        """
        p0, first, second = 1e-3, bends[0], bends[0] + bends[1]

        def log_k(x: np.ndarray) -> np.ndarray:
            bend = lambda at: 0.5 * np.logaddexp(0.0, (x - at) / 0.5)  # noqa: E731
            return (
                slopes[0] * (x - np.log(p0))
                + (slopes[1] - slopes[0]) * bend(first)
                + (slopes[2] - slopes[1]) * bend(second)
            )

        p = np.exp(np.linspace(np.log(p0), LOG_P_AXIS[1], 200_001))
        between = CubicTable(self.table(log_k))
        needed = (p - p0) / between(np.log(p))
        turns = np.flatnonzero(np.diff(needed) < 0.0)
        top = turns[0] if turns.size else p.size - 1
        square = fraction * needed[top]
        p_e, pulled_in = self.solve(log_k, np.array([square / (0.5 * EPS0)]), p0)
        expected = pytest.approx(
            p[np.argmax(needed >= square)], rel=2.0 * np.log(p[1] / p[0])
        )  # one step of the scan
        if fraction < 1.0 - 1e-6:
            assert p_e[0] + p0 == expected
        elif fraction > 1.0 + 1e-6 and not np.isnan(p_e[0]):
            back = needed[top] - needed[top:][np.argmax(np.diff(needed[top:]) > 0.0)]
            assert back < 1e-3 * needed[top]
            assert p_e[0] + p0 == expected
        assert pulled_in[0] == (np.isnan(p_e[0]) and turns.size > 0)

    @staticmethod
    def lowest(log_k, mean_square: float, load: float) -> float:
        p = np.exp(np.linspace(np.log(load), LOG_P_AXIS[1], 200_001))
        met = np.flatnonzero(load + mean_square * 0.5 * EPS0 * np.exp(log_k(np.log(p))) <= p)
        return float(p[met[0]] - load) if met.size else float("nan")

    @staticmethod
    def late(x: np.ndarray) -> np.ndarray:
        """Slope 0.54 at first, 5.9 between p = 0.22 and 0.59, 0.54 after."""
        return 0.54 * x + 5.37 * 0.26 * (
            np.logaddexp(0.0, (x - np.log(0.218)) / 0.26)
            - np.logaddexp(0.0, (x - np.log(0.218) - 1.0) / 0.26)
        )

    def test_the_lowest_is_taken_of_a_curve_that_bends_down_first(self):
        p0 = 7.76993940380478e-3
        mean_square = np.array([5.579454e10, 7.0515832e10])
        expected = [self.lowest(self.late, m, p0) for m in mean_square]
        np.testing.assert_allclose(self.solve(self.late, mean_square, p0)[0], expected, rtol=2e-3)


FOLDING_FREQUENCY_HZ = 1e6
FOLDING_LOAD = 1e-4  # of Y* q0 h_rms


@pytest.fixture(scope="module")
def folding(variant):
    return variant(**FOLDING)


@pytest.fixture(scope="module")
def load_pa(folding, scales_of):
    return FOLDING_LOAD * scales_of(folding).pressure_pa


@pytest.fixture(scope="module")
def curve(folding, load_pa, scales_of, gain_by_quadrature):
    """p_e and V(p_e) by quadrature; V has a maximum, falls by 5e-4 and rises again."""
    p = (
        np.exp(np.linspace(np.log(1.01 * FOLDING_LOAD), np.log(9.9), 250))
        * scales_of(folding).pressure_pa
    )
    gain = np.array([gain_by_quadrature(folding, FOLDING_FREQUENCY_HZ, x) / 2.0 for x in p])
    return p - load_pa, np.sqrt((p - load_pa) / gain)


class TestPullIn:
    def test_the_fold_is_found_and_nothing_past_it_is_given(
        self, folding, solve_sine, load_pa, curve
    ):
        _, v = curve
        fold = v[np.flatnonzero(np.diff(v) < 0.0)[0]]
        voltage = fold * np.array(
            [0.5, 0.9, 0.9999, 1.0001, 1.05, 2.0]
        )  # table against quadrature: 1e-4
        p_e, pulled_in = solve_sine(folding, FOLDING_FREQUENCY_HZ, voltage, load_pa)
        past = [False, False, False, True, True, True]
        np.testing.assert_array_equal(np.isnan(p_e), past)
        np.testing.assert_array_equal(pulled_in, past)

    def test_between_the_folds_the_lowest_branch_is_taken(
        self, folding, solve_sine, load_pa, curve
    ):
        p_e, v = curve
        top, bottom = np.flatnonzero(np.diff(v) < 0.0)[[0, -1]] + np.array([0, 1])
        between = v[bottom] + 0.7 * (v[top] - v[bottom])
        roots = np.count_nonzero(np.diff(np.sign(v - between)))
        assert roots == 3
        first = p_e[np.flatnonzero(v > between)[0]]
        # the curve is flat here: 1e-4 of V is a tenth of p_e, and the next root is four times as
        # far
        found, _ = solve_sine(folding, FOLDING_FREQUENCY_HZ, np.array([between]), load_pa)
        assert found[0] == pytest.approx(first, rel=0.3)

    def test_a_surface_flags_what_is_pulled_in(self, folding, load_pa, curve):
        _, v = curve
        fold = v[np.flatnonzero(np.diff(v) < 0.0)[0]]
        load_n = load_pa * FOLDING["contact_area_m2"]
        surface = folding.surface(
            np.array([FOLDING_FREQUENCY_HZ]), fold * np.array([0.9, 1.001, 1.2]), np.array([load_n])
        )
        np.testing.assert_array_equal(surface.pulled_in[0, :, 0], [False, True, True])
        for name in ("electrostatic_force_n", "cof", "current_rms_a"):
            np.testing.assert_array_equal(
                np.isnan(getattr(surface, name)[0, :, 0]), [False, True, True]
            )
        assert np.isfinite(surface.stuck_current_rms_a).all()
        assert not surface.within_theory[0, 1:, 0].any()


def test_a_pressure_beyond_the_table_has_no_answer(models, solve_sine, gain_by_quadrature):
    """400 V and 5 kPa lead to 1.1 MPa; 1000 V beyond the table's 2.7 MPa. Nothing has pulled in."""
    p_e, pulled_in = solve_sine(models["reference"], 250.0, np.array([400.0, 1000.0, 5000.0]), 5e3)
    assert p_e[0] == pytest.approx(
        400.0**2 / 2.0 * gain_by_quadrature(models["reference"], 250.0, 5e3 + p_e[0]), rel=1e-4
    )
    assert np.isnan(p_e[1:]).all()
    assert not pulled_in.any()


def test_many_touches_on_several_threads_are_those_one_by_one(models, sine_circuit):
    model, rng = models["reference"], np.random.default_rng(3)
    f, v, load = (
        np.exp(rng.uniform(0.0, 13.0, 10_000)),
        rng.uniform(0.0, 150.0, 10_000),
        rng.uniform(1e3, 2e4, 10_000),
    )
    whole, _ = solve(model.table, sine_circuit(model, f, v, load))
    for i in (0, 4095, 4096, 9999):
        assert whole[i] == solve(model.table, sine_circuit(model, f[i], v[i], load[i]))[0][0]


@pytest.mark.parametrize("name", FINGERS)
@given(
    f=st.floats(0.0, 6.0).map(lambda e: 10.0**e),
    v=st.floats(5.0, 150.0),
    load=st.floats(5e2, 2e4),
    step=st.floats(-1e-3, 1e-3),
)
@settings(max_examples=40)
def test_what_starts_at_a_pressure_close_by_ends_where_the_whole_way_does(
    models, sine_circuit, name, f, v, load, step
):
    model = models[name]
    near_pa, _ = solve(model.table, sine_circuit(model, f, np.array([v]), load))
    other = sine_circuit(model, f, np.array([v * (1.0 + step)]), load * (1.0 - step))
    whole, _ = solve(model.table, other)
    # Of the attraction, where the secant method ends: a step of 1e-6 leaves the order of 1e-10.
    assert solve_near(model.table, other, near_pa) == pytest.approx(whole, rel=1e-8, nan_ok=True)


@pytest.mark.parametrize("near_pa", [np.nan, -1e9, 1e12])
def test_a_start_that_is_far_off_or_none_is_not_taken(models, sine_circuit, near_pa):
    model = models["reference"]
    touch = sine_circuit(model, 100.0, np.array([100.0]), 2e3)
    whole, _ = solve(model.table, touch)
    found = solve_near(model.table, touch, np.array([near_pa]))
    assert found == pytest.approx(whole, rel=1e-8)
