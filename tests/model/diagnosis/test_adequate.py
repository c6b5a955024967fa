"""A model is adequate when nothing of unknown shape beside it is more likely, and the fit does not lack either."""

from types import SimpleNamespace

import numpy as np
import pytest

from model.diagnosis.weighing import DISCREPANCY_WINS, LACK_OF_FIT, MENDED, adequate, of_another_form


@pytest.mark.parametrize(
    ("odds", "p", "expected"),
    [(0.99, 1.01, True), (1.01, 1.01, False), (0.99, 0.99, False), (1.01, 0.99, False)],
)
def test_both_are_needed(odds: float, p: float, expected: bool) -> None:
    """`odds` and `p` in units of their limits."""
    alone = SimpleNamespace(log_evidence=-3.0)
    beside = SimpleNamespace(log_evidence=-3.0 + float(np.log(odds * DISCREPANCY_WINS)))
    candidate = SimpleNamespace(alone=alone, beside_discrepancy=beside)
    assert bool(adequate(candidate, p * LACK_OF_FIT)) is expected  # type: ignore[arg-type]


def of_evidence(alone: float, beside: float) -> SimpleNamespace:
    return SimpleNamespace(
        alone=SimpleNamespace(log_evidence=alone), beside_discrepancy=SimpleNamespace(log_evidence=beside)
    )


@pytest.mark.parametrize(("own", "expected"), [(1.01, True), (0.99, False), (-1.0, False)])
def test_a_form_that_is_only_mended_is_the_effects_own(own: float, expected: bool) -> None:
    """`own` in units of what it must say beyond any discrepancy, where one beside it adds 10 nats.

    A skin that stiffens by another law was unexplained, with 198 nats for its own form and 5 for what was left.
    """
    base = of_evidence(-300.0, -100.0)
    candidate = of_evidence(-100.0 + own * MENDED * 10.0, -100.0 + own * MENDED * 10.0 + 10.0)
    assert of_another_form(candidate, base) is expected  # type: ignore[arg-type]


def test_where_no_discrepancy_wins_the_form_is_not_another() -> None:
    """What only the test of fit finds lacking is judged by what it leaves."""
    assert not of_another_form(of_evidence(0.0, -2.0), of_evidence(-300.0, -100.0))  # type: ignore[arg-type]
