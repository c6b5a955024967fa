"""The contact theory's own error: its table against the committed comparison, and its use."""

from pathlib import Path

import numpy as np
import pytest

from model.contact import theory_error
from model.contact.theory_error import GAP_LENGTH_M, LOG_STD, PRESSURE_PA, theory_log_std
from tests.haptic_driver.commands import rows_of

TABLE = Path(__file__).parents[3] / "docs" / "validation.csv"
EARLIER = (
    (0.74, 0.75, 0.89),
    (0.86, 0.85, 0.92),
    (1.05, 0.99, 0.98),
)  # solver/theory, one grid of 1024 x 1024
LENGTHS = ("k_0_3_um", "k_1_um", "k_5_um")


def test_table_is_what_the_committed_comparison_found():
    """rms of log(solver/theory) at the finest grid, extrapolated to first order, or of the earlier
    comparison.
    """
    rows = [{key: float(value) for key, value in row.items()} for row in rows_of(TABLE)]
    wide = [row for row in rows if row["zeta1"] == 32]
    coarse, finest = sorted({row["points"] for row in wide})[-2:]
    for i, pressure in enumerate(PRESSURE_PA):
        for j, length in enumerate(LENGTHS):
            fine = {
                r["seed"]: r[length]
                for r in wide
                if (r["points"], r["pressure_pa"]) == (finest, pressure)
            }
            rough = {
                r["seed"]: r[length]
                for r in wide
                if (r["points"], r["pressure_pa"]) == (coarse, pressure)
            }
            limit = {s: (finest * fine[s] - coarse * rough[s]) / (finest - coarse) for s in fine}
            assert fine
            rms = max(np.sqrt(np.mean(np.log(list(each.values())) ** 2)) for each in (fine, limit))
            wanted = max(
                rms, abs(np.log(EARLIER[i][j])), 0.05
            )  # 0.05: the scatter between surfaces
            assert LOG_STD[i][j] == pytest.approx(wanted, abs=0.011)


def test_nodes_are_the_table_and_points_between_lie_between():
    p, h = np.meshgrid(PRESSURE_PA, GAP_LENGTH_M, indexing="ij")
    np.testing.assert_allclose(theory_log_std(p, h), LOG_STD, rtol=1e-12)
    middle = float(theory_log_std(np.sqrt(5e3 * 20e3), 1e-6))
    assert middle == pytest.approx(0.5 * (LOG_STD[0][1] + LOG_STD[1][1]))


def test_outside_the_compared_range_the_nearest_holds():
    assert theory_log_std(1.0, 1e-9) == pytest.approx(LOG_STD[0][0])
    assert theory_log_std(1e9, 1.0) == pytest.approx(LOG_STD[-1][-1])


def test_a_finger_is_known_by_its_dimensionless_pressure_and_length():
    own = theory_log_std(
        7.0 * 8e3,
        3.0 * 2e-6,
        pressure_scale_pa=7.0 * theory_error.PRESSURE_SCALE_PA,
        length_scale_m=3.0 * theory_error.LENGTH_SCALE_M,
    )
    assert own == pytest.approx(float(theory_log_std(8e3, 2e-6)))
    assert theory_log_std(5e3, 2e-6, pressure_scale_pa=1e4) != theory_log_std(5e3, 2e-6)
