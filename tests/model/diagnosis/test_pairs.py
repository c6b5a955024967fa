"""Which pairs are fitted: by what one more effect would explain of what the first leaves."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from model.diagnosis import hypotheses
from model.diagnosis.hypotheses import FITTED, Candidate, Promise, fit_pairs
from model.effects import CATALOGUE

KINDS = dict(zip("abcdefgh", CATALOGUE, strict=False))
LETTERS = {kind: name for name, kind in KINDS.items()}
Table = dict[str, float]


def made(names: str, evidence: float) -> Any:
    alone = SimpleNamespace(log_evidence=evidence)
    kinds = tuple(KINDS[name] for name in names)
    return SimpleNamespace(kinds=kinds, alone=alone, name="+".join(names))


def pairs(
    monkeypatch: pytest.MonkeyPatch, evidence: Table, promise: dict[str, Table]
) -> dict[str, float]:
    """Pairs that are fitted, with evidences and promises from tables instead of fits."""

    def beside(_: object, first: Candidate, singles: list[Candidate]) -> list[Promise]:
        gains = promise.get(LETTERS[first.kinds[0]], {})
        return [
            Promise(frozenset((*first.kinds, KINDS[n])), first.alone.log_evidence + gain)
            for n, gain in gains.items()
        ]

    def with_one_more(_: object, first: Candidate, more: Any) -> Any:
        names = "".join(sorted(LETTERS[kind] for kind in (*first.kinds, *more)))
        return made(names, evidence.get(names, -100.0))

    monkeypatch.setattr(hypotheses, "_beside", beside)
    monkeypatch.setattr(hypotheses, "with_one_more", with_one_more)
    singles = [made(name, value) for name, value in evidence.items() if len(name) == 1]
    found = fit_pairs(None, singles, lambda _: None)  # type: ignore[arg-type]
    return {c.name: c.alone.log_evidence for c in found}


def test_two_effects_are_found_behind_a_third_that_looks_like_both(monkeypatch):
    """A film of sweat was named for a polarization and a floating body: beside it neither helps."""
    evidence = {"a": 37.0, "b": 25.0, "c": 39.0, "d": 1.0, "cd": 40.0, "ab": 54.0}
    found = pairs(monkeypatch, evidence, {"c": {"d": 9.0}, "a": {"b": 50.0}})
    assert max(found, key=found.__getitem__) == "a+b"


def test_the_members_of_the_best_pair_are_asked_too(monkeypatch):
    """`h` is too weak alone to be asked, until it stands in the best pair; then it finds `g`."""
    evidence = {name: 20.0 - i for i, name in enumerate("abcdefgh")} | {"ah": 40.0, "gh": 60.0}
    found = pairs(monkeypatch, evidence, {"a": {"h": 30.0}, "h": {"g": 50.0}})
    assert max(found, key=found.__getitem__) == "g+h"


def test_the_pairs_that_promise_most_are_fitted_and_no_more(monkeypatch):
    evidence = {name: 20.0 - i for i, name in enumerate("abcdefgh")}
    promise = {"a": dict.fromkeys("bcdefgh", 10.0), "b": {"c": 60.0, "d": 2.0, "e": 12.0}}
    found = pairs(monkeypatch, evidence, promise)
    assert "b+c" in found
    assert len(found) == FITTED
    assert "b+d" not in found


def test_nothing_is_fitted_where_nothing_is_worth_its_prior(monkeypatch):
    assert pairs(monkeypatch, {"a": 3.0, "b": 2.0}, {}) == {}


@pytest.mark.parametrize("bent", [False, True])
def test_what_one_more_effect_explains_is_judged_with_all_as_loose_as_it_is(bent):
    """By the dense covariance.

    A floating body of lambda 306 was not tried beside a skin that stiffens: the finger, fitted
    without it, could take up what it does.
    """
    chance = np.random.default_rng(2)
    n, scale, count = 12, 1.3, len(KINDS["b"].parameters())
    direction, jacobian = 2.0 * chance.normal(size=n), chance.normal(size=(n, 3))
    residual, vector = 4.0 * direction + chance.normal(size=n), chance.normal(size=3)
    loose = 2.0 * chance.normal(size=(n, 2 if bent else 0))

    def whitened(_: object, vectors: np.ndarray) -> np.ndarray:
        return residual - (vectors[:, :3] - vector) @ jacobian.T - vectors[:, 3:4] * direction

    around = SimpleNamespace(
        residual=residual, jacobian=jacobian, vector=vector, kinds=(KINDS["a"],)
    )
    alone = SimpleNamespace(scale=scale, log_evidence=7.0)
    chosen: Any = SimpleNamespace(around=around, bent=loose, alone=alone, kinds=(KINDS["a"],))
    fit = SimpleNamespace(vector=np.zeros(count))
    other: Any = SimpleNamespace(fit=fit, kinds=(KINDS["b"],))
    problem: Any = SimpleNamespace(whitened=whitened)
    precision = np.linalg.inv(scale**2 * np.eye(n) + jacobian @ jacobian.T + loose @ loose.T)
    target = residual + jacobian @ vector
    chi2 = (direction @ precision @ target) ** 2 / (direction @ precision @ direction)
    (promise,) = hypotheses._beside(problem, chosen, [chosen, other])
    assert promise.pair == {KINDS["a"], KINDS["b"]}
    assert promise.log_evidence == pytest.approx(7.0 + 0.5 * chi2)
