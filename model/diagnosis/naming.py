"""Which effect: every candidate fitted, weighed against none and the catch-all, and what cannot be told apart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.stats import norm, qmc

from model.diagnosis.data import Measurements
from model.diagnosis.fit import Fit, Problem
from model.diagnosis.form import form_terms
from model.diagnosis.rival import Evidence, evidence, evidence_beside
from model.diagnosis.space import FARTHEST
from model.effects import CATALOGUE, Effect
from model.support.arrays import Array

PRIOR_NONE, PRIOR_UNKNOWN = 0.3, 0.14
PRIOR_EFFECTS = 1.0 - PRIOR_NONE - PRIOR_UNKNOWN  # shared by all of the catalogue
SURE = 0.95  # the probability that a name, or a group of them, must have
STARTS = (0.0, -2.0, 1.5, -3.0)
NEAR_NATS = 8.0  # rivals farther behind in evidence are refuted by these very data,
NEAR_BY_CURRENT = 4.0  # and so are these where current was measured: of 23 lists with such, 22 were right in the first;
SAME_PLACE_NATS = 4.0  # of those that act at one place, other forms may be each other; 1120 single effects: 3 at most,
KIN_NATS = 12.0  # and farther than that where forms are not the catalogue's
APART = 25.0  # lambda_ij from which two effects count as told apart
ALIKE = 9.0  # below which more of the same would hardly tell them apart
TOGETHER = 4.0  # and below which they are named together, whatever one data set says
REFITS = 4  # at most, of a model whose form is off,
WORTH_REFITTING = 0.3  # nats, of which one must say more for another
NO_TRACE = 2.0  # lambda below which nobody would call an effect missing: what a parameter costs by Akaike
DRAWS = 64  # of an effect's prior: shares of it to some per cent
NONE, UNKNOWN = "none", "unknown"


def words(name: str) -> str:
    """A candidate's name as people say it."""
    if name in (NONE, UNKNOWN):
        return {NONE: "nothing missing", UNKNOWN: "unknown effect"}[name]
    return name.replace("_", " ").replace("+", " with ")


@dataclass(frozen=True)
class Candidate:
    """One model, fitted: its own evidence, and with a discrepancy of unknown shape beside it.

    `bent` [n, m]: what its form may be off, whitened, as far as the data ask for it; `around`: the most probable
    parameters with that, which evidences are linear about. `fit` is of the exact form.
    """

    kinds: tuple[type[Effect], ...]
    fit: Fit
    alone: Evidence
    around: Fit
    bent: Array
    _beside: Callable[[], Evidence]

    @cached_property
    def beside_discrepancy(self) -> Evidence:
        """Evidence with a discrepancy of unknown shape beside the effects; worked out when first asked for."""
        return self._beside()

    @property
    def name(self) -> str:
        """The effects' names joined; `none` for the base model."""
        return "+".join(kind.name for kind in self.kinds) or NONE


def candidate(problem: Problem, kinds: tuple[type[Effect], ...], fit: Fit, *others: Fit) -> Candidate:
    """Weigh one fitted model; `others`: where else its parameters may lie if its form is off.

    Where it is, the finger and the gains are bent to make up for that in `fit`; again where they need not, for as long
    as that says more.
    """
    around, (alone, bent) = fit, _weigh(problem, fit)
    exact = alone.exact
    again = list(others)
    for _ in range(REFITS):
        again += [problem.refitted(around, bent)] if alone.bend else []
        before = alone.log_evidence
        for other in again:
            better, its_bent = _weigh(problem, other)
            if better.log_evidence > alone.log_evidence:
                around, alone, bent = other, replace(better, exact=exact), its_bent
        if alone.log_evidence - before < WORTH_REFITTING:
            break
        again = []
    noise = problem.noise
    return Candidate(
        kinds, fit, alone, around, bent, lambda: evidence_beside(around, noise, problem.discrepancy, bent, alone)
    )


def _weigh(problem: Problem, fit: Fit) -> tuple[Evidence, Array]:
    """Evidence about one fit, and what the form may be off as far as the data ask for it [n, m]."""
    forms = form_terms(problem, fit)
    found = evidence(fit, problem.noise, forms)
    return found, found.bend * forms[found.way] if found.bend else np.zeros((fit.residual.size, 0))


def near_nats(data: Measurements) -> float:
    """How far behind in evidence a rival may be that these data do not refute.

    Of friction alone the prior tells more than the data where rivals imitate each other.
    """
    return NEAR_BY_CURRENT if data.has_current else NEAR_NATS


def could_stand_for(rival: Candidate, best: Candidate, without: Candidate, fits: bool = True) -> bool:
    """Whether the effect that only `rival` has may be what `best` has instead, of another form: it explains much.

    Where both act at one place, another form of the one can look like the other: a slew limit that sets in softly is a
    roll-off, as long as nobody changes the amplitude. Where `best` is of another form itself (`fits` false), so may any
    be. `without`: the model with neither.
    """
    lead = best.alone.log_evidence - rival.alone.log_evidence
    gain = rival.alone.log_evidence - without.alone.log_evidence
    stages = {kind.stage for kind in set(best.kinds) ^ set(rival.kinds)}
    near = lead < SAME_PLACE_NATS if fits and len(stages) == 1 else not fits and lead < KIN_NATS
    return near and gain > lead


def testable_effects(data: Measurements, switched_on: Sequence[Effect]) -> list[type[Effect]]:
    """The candidates that could leave a trace in these columns and are not in the model already."""
    on = {effect.name for effect in switched_on}
    return [kind for kind in CATALOGUE if kind.name not in on and all(data.varies(column) for column in kind.needs)]


def fit_candidates(
    problem: Problem,
    base: Fit,
    kinds: Sequence[tuple[type[Effect], ...]],
    progress: Callable[[str], None],
) -> list[Candidate]:
    """Fit each model warm from `base`, several starts for its last effect."""
    found = []
    for kind in kinds:
        progress("+".join(k.name for k in kind) or NONE)
        found.append(candidate(problem, kind, problem.best_fit(kind, base.vector, STARTS)))
    return found


def with_one_more(problem: Problem, first: Candidate, kinds: tuple[type[Effect], ...]) -> Candidate:
    """The effects `kinds`, of which `first` has all but the last: fitted from there, with its form and as it is off."""
    exact = problem.best_fit(kinds, first.fit.vector, STARTS)
    if not first.bent.shape[1]:
        return candidate(problem, kinds, exact)
    off = problem.loosened(first.bent).best_fit(kinds, first.around.vector, STARTS)
    return candidate(problem, kinds, exact, problem.whole(off))


def unseen(problem: Problem, base: Candidate, kind: type[Effect]) -> float:
    """log evidence of that part of an effect's prior which leaves no trace in these data, beside the base model.

    From draws of the prior, with the finger and the gains as the base model has them, and linear about that.
    """
    _, signatures, visible = _drawn(problem, base, kind)
    residual, hidden = base.fit.residual / np.sqrt(base.fit.scale2), visible < NO_TRACE
    odds = np.exp(signatures[hidden] @ residual - 0.5 * visible[hidden])
    return base.alone.log_evidence + float(np.log(max(odds.sum(), 1e-300) / DRAWS))


def unseen_draws(problem: Problem, base: Candidate, kind: type[Effect]) -> tuple[Array, Array]:
    """Vectors [m, k] of those draws of an effect's prior that leave no trace in these data, and what each adds [m, n].

    In standard deviations of the noise.
    """
    vectors, signatures, visible = _drawn(problem, base, kind)
    return vectors[visible < NO_TRACE], signatures[visible < NO_TRACE]


def _drawn(problem: Problem, base: Candidate, kind: type[Effect]) -> tuple[Array, Array, Array]:
    """Draws [DRAWS, k] of an effect's prior beside the base model, what each adds [DRAWS, n], and how visible it is.

    In standard deviations of the noise; what the finger and the gains would take up does not count as visible, as far
    as they are not at their ends already.
    """
    fit, count = base.fit, len(kind.parameters())
    draws = norm.ppf(qmc.Sobol(count, seed=0).random(DRAWS))
    vectors = np.concatenate([np.broadcast_to(fit.vector, (DRAWS, fit.vector.size)), draws], axis=1)
    scale = np.sqrt(fit.scale2)
    own = fit.jacobian[:, np.abs(fit.vector) < FARTHEST] / scale
    signatures = (fit.residual - problem.whitened((kind,), vectors)) / scale
    along = signatures @ own
    taken_up = np.sum(along * np.linalg.solve(own.T @ own + np.eye(own.shape[1]), along.T).T, axis=1)
    return vectors, signatures, np.maximum(np.sum(signatures**2, axis=1) - taken_up, 0.0)


def imitate(problem: Problem, true: Fit, rival: Candidate) -> Fit:
    """`rival` fitted to what `true` predicts, without noise; its chi^2 is lambda_ij."""
    prediction = problem.predictor.predicted(true.kinds, true.vector[None])[0]
    noiseless = Problem(problem.predictor, prediction, problem.noise)
    fits = [noiseless.fit(rival.kinds, rival.fit.vector)]
    start = np.zeros(rival.fit.vector.size)
    shared = len(problem.predictor.free)
    start[:shared] = true.vector[:shared]
    fits.append(noiseless.fit(rival.kinds, start))
    return min(fits, key=lambda fit: fit.chi2)


def separation(problem: Problem, first: Candidate, second: Candidate) -> float:
    """lambda_ij in the noise that the first leaves, the smaller way round."""
    both = (imitate(problem, first.fit, second), imitate(problem, second.fit, first))
    return min(fit.chi2 for fit in both) / first.fit.scale2
