"""Small published problems of telling rival models apart, and sequential experiments on them.

Formulas, ranges, true parameters and noise are those of the papers that each problem names, as
collected in GPdoemd (Olofsson, Hebing, Niedenfuehr, Deisenroth and Misener, Comput. Chem. Eng. 125,
2019, 54), which also gives the ranges of the parameters. Every parameter has a normal prior, in its
logarithm where its range spans decades: its middle is that of the range and its standard deviation
half of it, so the range is no bound.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple, cast

import numpy as np
from scipy.optimize import least_squares
from scipy.special import exp1

from model.planning.discrimination import Pair, by_block, choose, nothing, weights
from model.planning.separation import APART
from model.support.arrays import Array

STEP = 1e-5  # of finite differences, in prior standard deviations
SURE = 0.99  # a probability above it is a name

FAR = 1e8  # standard deviations; stands for a prediction that overflows
STARTS = 100  # of a fit, drawn from the prior
CLOSE = 1e-4  # where a fit may stop, of its chi^2 or of its vector

Predict = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Rival:
    """`predict(points [d, n], parameters [k, m, 1])` is [m, n], or [m, n, outputs]; `ranges` [k, 2]
    of parameters.
    """

    predict: Predict
    ranges: Sequence[tuple[float, float]]
    log: bool = True

    def parameters(self, vectors: Array) -> Array:
        """[k, m, 1] of [m, k] in prior standard deviations."""
        low, high = (np.log(self.ranges) if self.log else np.array(self.ranges)).T
        values = (0.5 * (low + high) + 0.5 * (high - low) * vectors).T[:, :, None]
        return np.asarray(np.exp(values) if self.log else values)


@dataclass(frozen=True)
class Problem:
    """Rivals, of which `truth` is true with `parameters`; `axes` of the grid of permitted points;
    noise per output.
    """

    name: str
    rivals: Sequence[Rival]
    axes: Sequence[Array]
    truth: int
    parameters: Sequence[float]
    std: Sequence[float]
    first: int  # points, before any are chosen
    budget: int = 40  # points in all

    @property
    def grid(self) -> Array:
        """Permitted points [d, n]."""
        return np.array(list(product(*self.axes))).T

    def predicted(self, rival: Rival, points: Array, vectors: Array) -> Array:
        """[m, n * outputs] of vectors [m, k], in standard deviations of the noise."""
        with np.errstate(all="ignore"):
            return self.scaled(rival.predict(points, rival.parameters(vectors)))

    def scaled(self, predicted: Array) -> Array:
        """[m, n * outputs] in standard deviations of the noise."""
        values = predicted.reshape(*predicted.shape[:2], -1) / self.std
        return np.where(np.isfinite(values), values, FAR).clip(-FAR, FAR).reshape(len(values), -1)

    def slopes(self, rival: Rival, points: Array, vector: Array) -> tuple[Array, Array]:
        """Prediction [n * outputs], and its slopes [n * outputs, k]."""
        values = self.predicted(
            rival, points, np.vstack([vector, vector + STEP * np.eye(vector.size)])
        )
        return values[0], (values[1:] - values[0]).T / STEP


class Fit(NamedTuple):
    """The likeliest vector [k], its covariance [k, k] and the logarithm of the evidence
    (Laplace).
    """

    vector: Array
    covariance: Array
    log_evidence: float


def fitted(problem: Problem, rival: Rival, points: Array, observed: Array, starts: Array) -> Fit:
    """Least squares with the prior, from the first of the starts [m, k] and from the likeliest of
    the others.
    """
    unit = np.eye(len(rival.ranges))

    def away(u: Array) -> Array:
        return np.concatenate([problem.predicted(rival, points, u[None])[0] - observed, u])

    def slope(u: Array) -> Array:
        return np.vstack([problem.slopes(rival, points, u)[1], unit])

    misfit = np.sum((problem.predicted(rival, points, starts) - observed) ** 2, axis=1) + np.sum(
        starts**2, axis=1
    )
    these = {0, int(1 + misfit[1:].argmin())} if len(starts) > 1 else {0}
    found = [
        least_squares(away, starts[i], slope, method="lm", ftol=CLOSE, xtol=CLOSE) for i in these
    ]
    best = min(found, key=lambda fit: float(fit.cost))
    jacobian = slope(best.x)
    covariance = np.asarray(np.linalg.inv(jacobian.T @ jacobian), dtype=np.float64)
    return Fit(
        best.x, covariance, -float(best.cost) + 0.5 * float(np.linalg.slogdet(covariance)[1])
    )


def probabilities(fits: Sequence[Fit]) -> Array:
    """Of each rival; all were equally likely before."""
    logs = np.array([fit.log_evidence for fit in fits])
    weight = np.exp(logs - logs.max())
    return np.asarray(weight / weight.sum())


def next_point(problem: Problem, points: Array, fits: Sequence[Fit], least: float) -> int | None:
    """The grid's point that the score chooses, as `model.planning.design` asks it; None where none
    adds `least`.

    Beside the likeliest rival, each other one is what it would be if the data were what the
    likeliest says they are.
    """
    grid, probability = problem.grid, probabilities(fits)
    order = np.argsort(-probability)
    first = problem.rivals[order[0]]
    said = problem.predicted(first, points, fits[order[0]].vector[None])[0]
    means, spreads = [], []
    for i in order:
        vector = fits[i].vector
        if i != order[0]:
            vector = fitted(problem, problem.rivals[i], points, said, vector[None]).vector
        mean, slope = problem.slopes(problem.rivals[i], grid, vector)
        means.append(mean)
        spreads.append(slope @ np.linalg.cholesky(fits[i].covariance))
    block = np.repeat(np.arange(grid.shape[1]), len(problem.std))
    pairs = []
    for (i, j), weight in weights([float(probability[k]) for k in order]).items():
        told = by_block(
            means[i] - means[j], np.hstack([spreads[i], spreads[j]]), block, grid.shape[1]
        )
        pairs.append(Pair((str(i), str(j)), weight, told, nothing(told.moment.shape[1])))
    choices = choose(pairs, np.ones(grid.shape[1]), 1, 1.0, APART, least)
    return choices[0].block if choices else None


class Outcome(NamedTuple):
    """The rival that is named, if any, after how many points."""

    named: int | None
    points: int


def experiment(problem: Problem, seed: int, *, by_score: bool, least: float = 0.0) -> Outcome:
    """Points one after the other until a rival is named or the budget is spent.

    Each is the one that the score chooses, or one at random, as also where none adds `least`
    (`separation.choose`). Of one seed, the first points and the noise of the n-th measurement are
    the same however points are chosen.
    """
    rng, grid = np.random.default_rng(seed), problem.grid
    noise = rng.normal(size=(problem.budget, len(problem.std)))
    shuffled = rng.integers(grid.shape[1], size=problem.budget)
    draws = [rng.normal(size=(STARTS, len(rival.ranges))) for rival in problem.rivals]
    before = [np.zeros(len(rival.ranges)) for rival in problem.rivals]
    parameters = np.array(problem.parameters)[:, None, None]
    true = problem.scaled(problem.rivals[problem.truth].predict(grid, parameters)).reshape(
        -1, len(problem.std)
    )
    taken = [int(point) for point in shuffled[: problem.first]]
    while True:
        points, observed = grid[:, taken], (true[taken] + noise[: len(taken)]).ravel()
        fits = [
            fitted(problem, rival, points, observed, np.vstack([start, others]))
            for rival, start, others in zip(problem.rivals, before, draws, strict=True)
        ]
        before, probability = [fit.vector for fit in fits], probabilities(fits)
        if probability.max() > SURE or len(taken) == problem.budget:
            return Outcome(
                int(probability.argmax()) if probability.max() > SURE else None, len(taken)
            )
        point = next_point(problem, points, fits, least) if by_score else None
        taken.append(int(shuffled[len(taken)]) if point is None else point)


class Count(NamedTuple):
    """How often the right rival was named, a wrong one, none; the median of points to the right
    name, else infinite.
    """

    right: int
    wrong: int
    none: int
    points: float


def counted(problem: Problem, seeds: Sequence[int], *, by_score: bool, least: float = 0.0) -> Count:
    """Over one experiment per seed."""
    outcomes = [experiment(problem, seed, by_score=by_score, least=least) for seed in seeds]
    right, none = ([o.named == named for o in outcomes] for named in (problem.truth, None))
    points = [o.points if named else np.inf for o, named in zip(outcomes, right, strict=True)]
    median = float(np.sort(points)[len(points) // 2])
    return Count(sum(right), len(outcomes) - sum(right) - sum(none), sum(none), median)


def _clumps_2(ktc: Array) -> Array:
    """What a stirred reactor leaves of clumps that react by the second order."""
    z = np.minimum(1.0 / ktc, 500.0)  # beyond, the next term of the series is below 1e-5
    return np.asarray(np.where(z < 500.0, z * np.exp(z) * exp1(z), 1.0 - ktc))


def _function(names: str, formula: str) -> Callable[..., Array]:
    """A formula of these names, as text."""
    known = {**vars(np), "clumps_2": _clumps_2}
    return cast(Callable[..., Array], eval(f"lambda {names}: {formula}", known))


def _kinetic(
    names: str, ranges: Sequence[tuple[float, float]], *formulas: str, log: bool = True
) -> Rival:
    """A rival by its formula, or one per output, of a point's coordinates and then the parameters,
    which are `names`.
    """
    outputs = [_function(names, formula) for formula in formulas]

    def predict(x: Array, p: Array) -> Array:
        values = [output(*x, *p) + 0.0 * x[0] for output in outputs]
        return np.stack(values, axis=-1) if len(values) > 1 else np.asarray(values[0])

    return Rival(predict, ranges, log)


def _buzzi_ferraris_1983() -> Problem:
    """Buzzi-Ferraris and Forzatti, Chem. Eng. Sci. 38, 1983, 225: synthesis of methanol, five rate
    equations.
    """
    ranges = ((1.0, 1e4), (1e-2, 10.0), (1e-4, 1.0), (1.0, 1e3), (1e-10, 1.0))
    resistances = (
        "(k1 + k2*a + k3*b + k4*c)**2",
        "(k1 + k2*a + k3*b + k4*a*b)",
        "(b**2*(k1 + k2*c + k3*b) + k4*b*c)",
        "(b*(k1 + k2*a + k3*c/b + k4*c)**2)",
        "(k1 + k2*b + k3*a*b + k4*c)**2",
    )
    rivals = [
        _kinetic("a, b, c, k1, k2, k3, k4, k", ranges, f"(a*b**2 - c/k)/{one}")
        for one in resistances
    ]
    axes = (np.linspace(15.0, 25.0, 4), np.linspace(200.0, 250.0, 4), np.linspace(5.0, 10.0, 4))
    true = (1704.0, 4.25, 0.241, 444.6, 1.7e-5)
    return Problem("Buzzi-Ferraris 1983", rivals, axes, 4, true, (4e-7**0.5,), first=5)


def _buzzi_ferraris_1984() -> Problem:
    """Buzzi-Ferraris, Forzatti, Emig and Hofmann, Chem. Eng. Sci. 39, 1984, 81: four models of two
    rates.
    """
    resistances = (
        ("(1 + k3*a + k4*b)", "(1 + k3*a + k4*b)"),
        ("(1 + k3*a + k4*b)**2", "(1 + k3*a)**2"),
        ("(1 + k3*b)**2", "(1 + k4*a)**2"),
        ("(1 + k3*a + k4*b)", "(1 + k3*a)"),
    )
    rivals = [
        _kinetic("a, b, k1, k2, k3, k4", ((1e-4, 1.0),) * 4, f"k1*a*b/{one}", f"k2*a*b/{other}")
        for one, other in resistances
    ]
    axis = np.linspace(5.0, 55.0, 8)
    true, std = (0.1, 0.01, 0.1, 0.01), (0.35**0.5, 2.3e-3**0.5)
    return Problem("Buzzi-Ferraris 1984", rivals, (axis, axis), 0, true, std, first=3)


def _ammonia(t: Array, p: Array, ammonia: Array) -> tuple[Array, Array, Array, Array]:
    """Fugacities of nitrogen, hydrogen and ammonia (atm) and the equilibrium's constant at t (K)
    and p (atm).

    Activities: Dyson and Simon, Ind. Eng. Chem. Fundam. 7, 1968, 605; constant: Gillespie and
    Beattie, Phys. Rev. 36, 1930, 743. Hydrogen is three times the nitrogen.
    """
    log_h = p * np.exp(0.541 - 3.8402 * t**0.125) - p**2 * np.exp(-15.98 - 0.1263 * np.sqrt(t))
    log_h += 300.0 * np.exp(-5.941 - 0.011901 * t) * np.expm1(-p / 300.0)
    of_n = 0.93431737 + 3.101804e-4 * t + 2.95896e-4 * p - 2.707279e-7 * t**2 + 4.775207e-7 * p**2
    of_a = 0.1438996 + 2.028538e-3 * t - 4.487672e-4 * p - 1.142945e-6 * t**2 + 2.761216e-7 * p**2
    log10_k = 2.6899 - 2.691122 * np.log10(t) - 5.519265e-5 * t + 1.848863e-7 * t**2 + 2001.6 / t
    nitrogen = 0.25 * (1.0 - ammonia) * p
    return nitrogen * of_n, 3.0 * nitrogen * np.exp(log_h), ammonia * p * of_a, 10.0**log10_k


def _buzzi_ferraris_1990() -> Problem:
    """Buzzi-Ferraris, Forzatti and Canu, Chem. Eng. Sci. 45, 1990, 477: synthesis of ammonia, four
    rate equations.
    """

    def of(formula: str, constants: int) -> Rival:
        """Of fugacities, the equilibrium's constant, and constants that depend on temperature."""
        rate = _function("n, h, a, k, *c", formula)

        def predict(x: Array, p: Array) -> Array:
            cold = (x[0] - 700.0) / x[0]
            levels, slopes = p[::2], p[1::2]
            return np.asarray(rate(*_ammonia(*x), *np.exp(levels - slopes * cold)))

        return Rival(predict, ((0.1, 10.0), (0.1, 100.0)) * constants, log=False)

    rivals = [
        of("(n - a**2/(h**3*k**2))*h**1.5/(c[0]*a)", 1),
        of("(n*h - a**2/(h*k)**2)/(c[0]*a)", 1),
        of("(sqrt(n*h**3) - a/k)/(a*c[0] + sqrt(n/h)*c[1])", 2),
        of("(sqrt(n*h**3) - a/k)/(a*c[0] + n*c[1] + a/n*c[2])", 3),
    ]
    axes = (np.linspace(703.0, 753.0, 4), np.linspace(300.0, 350.0, 4), np.linspace(0.1, 0.2, 4))
    true = (3.68064, 11.80406)
    return Problem("Buzzi-Ferraris 1990", rivals, axes, 0, true, (90.0**0.5,), first=3)


def _michalik_2010() -> Problem:
    """Michalik, Stuckert and Marquardt, Ind. Eng. Chem. Res. 49, 2010, 913: ten models of one
    parameter each.
    """
    orders = ("1", "a", "b", "c", "a*b", "a*c", "b*c", "a*b*c", "a**2*b", "a*b**2")
    axes = (np.linspace(0.0, 10.0, 4), np.linspace(0.0, 10.0, 4), np.linspace(0.0, 100.0, 4))
    rivals = [_kinetic("a, b, c, k", ((0.0, 1e3),), f"k*{one}", log=False) for one in orders]
    return Problem("Michalik 2010", rivals, axes, 8, (1.0,), (1.0,), first=1)


def _vanlier_2014() -> Problem:
    """Vanlier, Tiemann, Hilbers and van Riel, BMC Syst. Biol. 8, 2014, 20: four linear models, each
    within the next.
    """
    terms = ("p[0]*t", "p[1]*t**2", "p[2]*sin(0.2*t**3)", "p[3]*t*sin(2*t)")
    ranges = ((-10.0, 10.0),) * 4
    rivals = [_kinetic("t, *p", ranges[:n], " + ".join(terms[:n]), log=False) for n in (1, 2, 3, 4)]
    axis, true = np.linspace(-2.5, 2.5, 51), (-1.0, 0.5, -6.0)
    return Problem("Vanlier 2014", rivals, (axis,), 2, true, (0.5**0.5,), first=2)


def _mixing(truth: int) -> Problem:
    """Order of a reaction (0, 1 or 2) and whether a reactor mixes molecules or clumps, from what is
    left at its end.

    Textbook solutions (Levenspiel, Chemical Reaction Engineering, 3rd ed., 1999, ch. 16) of a plug
    flow and a stirred reactor; a point is the time in it, the concentration that enters, and which
    of the two. Of any order but the first, mixing matters in the stirred one alone.
    """

    plug_0, plug_2 = "maximum(1 - k*t/c, 0)", "1/(1 + k*t*c)"
    reactors = {
        "order 0, molecules": (plug_0, plug_0),
        "order 0, clumps": (plug_0, "1 + k*t/c*(exp(-c/(k*t)) - 1)"),
        "order 1": ("exp(-k*t)", "1/(1 + k*t)"),
        "order 2, molecules": (plug_2, "2/(1 + sqrt(1 + 4*k*t*c))"),
        "order 2, clumps": (plug_2, "clumps_2(k*t*c)"),
    }
    rivals = [
        _kinetic("t, c, flows, k", ((1e-6, 0.1),), f"flows*({plug}) + (1 - flows)*({stirred})")
        for plug, stirred in reactors.values()
    ]
    axes = (np.geomspace(1.0, 100.0, 6), np.geomspace(0.01, 1.0, 6), np.array([0.0, 1.0]))
    true = ((0.006, 0.006, 0.015, 0.025, 0.025)[truth],)
    name = f"mixing: {list(reactors)[truth]}"
    return Problem(name, rivals, axes, truth, true, (0.05,), first=1)


PROBLEMS = (
    _buzzi_ferraris_1983(),
    _buzzi_ferraris_1984(),
    _buzzi_ferraris_1990(),
    _michalik_2010(),
    _vanlier_2014(),
    *(_mixing(truth) for truth in range(5)),
)
