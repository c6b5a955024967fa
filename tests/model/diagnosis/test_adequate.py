"""A model is adequate when nothing of unknown shape beside it is more likely, and the fit does not lack either."""

from types import SimpleNamespace

import numpy as np
import pytest

from model.diagnosis.verdict import DISCREPANCY_WINS, LACK_OF_FIT, adequate


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
