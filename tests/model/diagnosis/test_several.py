"""Which sets of effects are looked at."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from model.diagnosis.several import FITTED, Search
from model.effects import CATALOGUE

KINDS = dict(zip("abcdefgh", CATALOGUE, strict=False))
LETTERS = {kind: name for name, kind in KINDS.items()}


def letters(kinds: Any) -> str:
    return "".join(sorted(LETTERS[kind] for kind in kinds))


def made(names: str, evidence: float) -> Any:
    """Effects that leave the less chi^2 the more evidence they have."""
    fit = SimpleNamespace(chi2=1000.0 - 2.0 * evidence)
    alone = SimpleNamespace(log_evidence=evidence)
    return SimpleNamespace(kinds=tuple(KINDS[name] for name in names), alone=alone, fit=fit)


@dataclass
class MadeUp(Search):
    """Evidences and promises from tables instead of fits."""

    def having(self, evidence: dict[str, float], promise: dict[str, dict[str, float]]) -> "MadeUp":
        self.evidence, self.promise = evidence, promise
        return self

    def _likely(self, kinds: Any) -> Any:
        names = letters(kinds)
        return {KINDS[name]: value for name, value in self.promise.get(names, {}).items()}

    def _fit(self, kinds: Any) -> Any:
        names = letters(kinds)
        return made(names, self.evidence.get(names, -100.0))


def search(evidence: dict[str, float], promise: dict[str, dict[str, float]]) -> MadeUp:
    singles = [made(name, value) for name, value in evidence.items() if len(name) == 1]
    problem: Any = None
    return MadeUp(problem, made("", 0.0), singles, lambda _: None).having(evidence, promise)


def test_two_effects_are_found_behind_a_third_that_looks_like_both() -> None:
    """A film of sweat was named for a polarization and a floating body: beside the film neither helps."""
    evidence = {"a": 37.0, "b": 25.0, "c": 39.0, "d": 1.0, "cd": 40.0, "ab": 54.0}
    found = search(evidence, {"c": {"d": 9.0}, "a": {"b": 50.0}}).best_with_one_more(made("c", 39.0))
    assert found is not None
    assert letters(found.kinds) == "ab"


@pytest.mark.parametrize(("exact", "mends"), [(6.5, True), (6.7, False)])
def test_an_effect_that_is_not_needed_in_its_own_form_mends_anothers(
    monkeypatch: pytest.MonkeyPatch, exact: float, mends: bool
) -> None:
    """A polarization of another form had a moist skin named beside it, for 15 nats, all of its being bent.

    `exact`: what it adds in its own form, in nats; 3 and its prior of 3.6 it needs.
    """
    made_up = search({"a": 60.0, "b": 20.0, "ab": 75.0}, {})
    in_own_form = {"a": 50.0, "b": 10.0, "ab": 50.0 + exact}

    def fitted(kinds: Any) -> Any:
        found = made(letters(kinds), made_up.evidence[letters(kinds)])
        found.alone.exact = in_own_form[letters(kinds)]
        return found

    monkeypatch.setattr(made_up, "_fit", fitted)
    assert made_up.mends_a_form(fitted((KINDS["a"], KINDS["b"]))) is mends


@pytest.mark.parametrize(("gain", "exact", "stands"), [(11.0, 15.1, True), (11.0, 14.9, False), (12.1, 40.0, False)])
def test_what_a_form_that_is_off_says_as_well_stands_for_it(
    monkeypatch: pytest.MonkeyPatch, gain: float, exact: float, stands: bool
) -> None:
    """A trapped charge of another form was listed with an electrowetting: 10 nats beside its form, 24 without.

    Of a first effect that explains 60 nats; both gains count the prior of 3.6.
    """
    prior = -np.log(0.56 / 20)
    made_up = search({"a": 60.0, "b": 20.0, "ab": 60.0 + prior + gain}, {})
    in_own_form = {"a": 50.0, "b": 10.0, "ab": 50.0 + prior + exact}

    def fitted(kinds: Any) -> Any:
        found = made(letters(kinds), made_up.evidence[letters(kinds)])
        found.alone.exact = in_own_form[letters(kinds)]
        return found

    monkeypatch.setattr(made_up, "_fit", fitted)
    assert bool(made_up.stands_for_a_form(fitted((KINDS["a"], KINDS["b"])))) is stands


@pytest.mark.parametrize(("elsewhere", "rests"), [(0.43, True), (0.45, False)])
def test_an_effect_that_shows_at_one_setting_is_not_needed(
    monkeypatch: pytest.MonkeyPatch, elsewhere: float, rests: bool
) -> None:
    """A gap that rises with speed had a friction over speed named beside it: at the slower speed one setting was read.

    It adds 15 nats and needs 6.6; the share `elsewhere` of what it explains is not of that setting, read four times.
    """
    setting = np.array([0, 0, 0, 0, 1, 2])
    squares = np.array([*[0.25 * (1.0 - elsewhere)] * 4, elsewhere / 2, elsewhere / 2])
    still = {"jacobian": np.zeros((6, 1)), "vector": np.zeros(1)}
    residuals = {"a": np.sqrt(1.0 + squares), "b": np.sqrt(1.0 + squares[[5, 4, 0, 1, 2, 3]]), "ab": np.ones(6)}
    made_up = search({"a": 10.0, "b": -20.0, "ab": 25.0}, {})
    data = SimpleNamespace(replicate_groups=lambda apart, sessions_apart: setting)
    made_up.problem = SimpleNamespace(predictor=SimpleNamespace(data=data))  # type: ignore[assignment]

    def fitted(kinds: Any) -> Any:
        found = made(letters(kinds), made_up.evidence[letters(kinds)])
        found.alone.scale, found.bent = 1.0, np.zeros((6, 0))
        found.around = SimpleNamespace(residual=residuals[letters(kinds)], **still)
        return found

    monkeypatch.setattr(made_up, "_fit", fitted)
    assert made_up.rests_on_one_setting(fitted((KINDS["a"], KINDS["b"]))) is rests


@pytest.mark.parametrize("also_named", [False, True])
def test_the_pairs_that_promise_most_are_fitted_and_no_more(also_named: bool) -> None:
    """From both sides of a pair; by what the first says, and what the second would explain."""
    promise = {"a": dict.fromkeys("bcd", 10.0) | {"e": 1.0}, "b": {"c": 60.0, "d": 2.0, "e": 12.0}}
    if also_named:
        promise["c"] = {"b": 70.0, "a": 3.0}
    made_up = search({name: 20.0 - i for i, name in enumerate("abcdefgh")}, promise)
    pairs = [letters(pair) for pair in made_up._pairs]
    assert pairs[0] == "bc"
    assert len(pairs) == len(set(pairs)) == FITTED
    assert "bd" not in pairs


@pytest.mark.parametrize("bent", [False, True])
def test_what_one_more_effect_explains_is_judged_with_all_as_loose_as_it_is(
    monkeypatch: pytest.MonkeyPatch, bent: bool
) -> None:
    """By the dense covariance. A floating body of lambda 306 was not tried beside a skin that stiffens.

    The finger, fitted without it, could take up what it does. Nor was electrowetting, for what a form was off.
    """
    chance = np.random.default_rng(2)
    n, scale, count = 12, 1.3, len(KINDS["b"].parameters())
    residual, jacobian, vector = chance.normal(size=n), chance.normal(size=(n, 3)), chance.normal(size=3)
    loose = 2.0 * chance.normal(size=(n, 2 if bent else 0))
    direction = chance.normal(size=n)

    def whitened(_: object, vectors: np.ndarray) -> np.ndarray:
        return residual - (vectors[:, :3] - vector) @ jacobian.T - vectors[:, 3:4] * direction

    around = SimpleNamespace(residual=residual, jacobian=jacobian, vector=vector, kinds=(KINDS["a"],))
    chosen: Any = SimpleNamespace(around=around, bent=loose, alone=SimpleNamespace(scale=scale))
    made_up = search({"a": 2.0, "b": 1.0}, {})
    alone = SimpleNamespace(fit=SimpleNamespace(vector=np.zeros(count)))
    monkeypatch.setattr(made_up, "_fit", lambda kinds: alone)
    monkeypatch.setattr(made_up, "problem", SimpleNamespace(whitened=whitened))
    precision = np.linalg.inv(scale**2 * np.eye(n) + jacobian @ jacobian.T + loose @ loose.T)
    target = residual + jacobian @ vector
    expected = (direction @ precision @ target) ** 2 / (direction @ precision @ direction)
    assert made_up._score(chosen, KINDS["b"]) == pytest.approx(expected)
