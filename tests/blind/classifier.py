"""Boosted trees answer the sets of a plan: what a classifier makes of the same data.

The project's own model simulates the sets that it is trained on, each with one effect or none. Its
features are what the base model leaves of friction and the other witnesses at each setting of the
plan, once its own parameters have been fitted.

Features are settings, so it can be asked only about sets that share theirs with many others:
another plan needs another training. It knows no pair and nothing outside the catalogue: two
effects, or something unknown, it can only call by one name, or by none.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from model.description import ModelDescription
from model.diagnosis.data import Measurements, read_measurements
from model.diagnosis.levels import rows_in_order
from model.diagnosis.noise import Noise, noise_of
from model.diagnosis.space import FARTHEST, Predictor
from model.diagnosis.witness import FRICTION
from model.effects import CATALOGUE, Effect

from .scores import NO_TRACE, NONE, Guess

FEWEST = 10  # sets that share their settings, and so make a plan
TEMPLATES = 8  # of them, whose order and stated noise the simulated sets take over
DRAWS = 120  # simulated sets for each effect, and three times as many with nothing hidden
KEPT_BACK = 5  # every fifth simulated set says how often the classifier is right
FEWEST_IN_LEAF = 10
STEPS, LONGEST = 5, 2.0  # of the fit, in standard deviations of the priors
SMALL = 1e-3  # of finite differences, in the same
PARTS = 3  # of a session, for what drifts
FINGERS = ("sliding", "resting", "none")
Array = np.ndarray
Plan = tuple[tuple[float, ...], ...]


class Template(NamedTuple):
    """The conditions of one set, without what was measured."""

    data: Measurements
    predictor: Predictor
    noise: Noise


def classified(
    description: ModelDescription, paths: Sequence[Path], draws: int = DRAWS
) -> tuple[dict[str, Guess], list[str]]:
    """Answers by file name to the sets that share their settings with many; and notes on each plan.

    Raises `ImportError` without scikit-learn.
    """
    from sklearn.ensemble import HistGradientBoostingClassifier

    answers, notes = dict[str, Guess](), list[str]()
    for plan, files in _plans(paths).items():
        if len(files) < FEWEST:
            continue
        templates = [template(description, data) for data in files.values()]
        drew = simulated(templates[:TEMPLATES], np.random.default_rng(0), draws)
        rows, names = (np.array(column) for column in zip(*drew, strict=True))
        kept_back = np.arange(names.size) % KEPT_BACK == 0
        trees = HistGradientBoostingClassifier(min_samples_leaf=FEWEST_IN_LEAF, random_state=0)
        trees.fit(rows[~kept_back], names[~kept_back])
        shares = trees.predict_proba(np.array([features(template) for template in templates]))
        for name, share in zip(files, shares, strict=True):
            best = int(np.argmax(share))
            answers[name] = Guess(str(trees.classes_[best]), float(share[best]))
        right = 100 * trees.score(rows[kept_back], names[kept_back])
        notes.append(
            f"{len(files)} sets that share {len(plan)} settings, witness by witness: "
            f"learnt from {np.sum(~kept_back)} simulated ones; "
            f"of {np.sum(kept_back)} more it answers {right:.0f} % rightly"
        )
    return answers, notes or [f"not asked: no {FEWEST} sets share their settings"]


def _plans(paths: Sequence[Path]) -> dict[Plan, dict[str, Measurements]]:
    """Sets by what was set in them and how often; without those of unknown noise."""
    plans: dict[Plan, dict[str, Measurements]] = defaultdict(dict)
    for path in paths:
        data = read_measurements(path)
        if noise_of(data) is not None:
            rows, counts = np.unique(settings(data), axis=0, return_counts=True)
            plan = tuple(tuple(row) for row in np.column_stack([rows, counts]).tolist())
            plans[plan][path.name] = data
    return dict(plans)


def settings(data: Measurements) -> Array:
    """Witness, finger, frequency, voltage, load and speed of every observation [n, 6]."""
    columns, driven = data.columns, data.driven
    finger = np.full(data.count, FINGERS[0]) if data.finger is None else data.finger
    witness = np.full(data.count, FRICTION) if data.witness is None else data.witness
    return np.column_stack(
        [
            witness,
            [FINGERS.index(one) for one in finger],
            np.where(driven, columns["frequency_hz"], 0.0),
            columns["voltage_v"],
            columns["normal_force_n"],
            columns.get("speed_m_s", np.zeros(data.count)),
        ]
    )


def template(description: ModelDescription, data: Measurements) -> Template:
    noise = noise_of(data)
    assert noise is not None
    return Template(data, Predictor(description, data), noise)


def simulated(
    templates: Sequence[Template], rng: np.random.Generator, draws: int
) -> Iterator[tuple[Array, str]]:
    """Features and names of sets that the model simulates; `none` where an effect leaves no trace.

    Fingers, rigs and effects are drawn from the model's own priors.
    """
    columns = [set(template.data.columns) for template in templates]
    known = [kind for kind in CATALOGUE if set(kind.needs) <= set.intersection(*columns)]
    for kinds in [(), (), (), *((kind,) for kind in known)]:
        for number in range(draws):
            template = templates[number % len(templates)]
            drew = _drawn(template, kinds, rng)
            if drew is not None:
                values, name = drew
                yield features(template, values), name


def _drawn(
    template: Template, kinds: tuple[type[Effect], ...], rng: np.random.Generator
) -> tuple[Array, str] | None:
    """What one set observes [n] and what is hidden; None where such a finger has no equilibrium."""
    _, predictor, noise = template
    vector = rng.normal(size=predictor.size(kinds))
    clean = predictor.predicted(kinds, vector[None])[0]
    if not np.isfinite(clean).all():
        return None
    values = clean + noise.lower @ rng.normal(size=clean.size)
    if not kinds:
        return values, NONE
    base = predictor.predicted((), vector[None, : len(predictor.free)])[0]
    trace = noise.whiten(np.nan_to_num(predictor.less(clean, base)))
    return values, kinds[0].name if trace @ trace >= NO_TRACE else NONE


def features(template: Template, values: Array | None = None) -> Array:
    """One row of numbers: residuals by setting and by part of a session, gains, what was fitted.

    Residuals are in standard deviations, so that sets of unlike noise compare.

    `values` [n] stands for what the set itself observes.
    """
    data, predictor, noise = template
    left, fitted = beside_base(predictor, noise, data.observed if values is None else values)
    gain = np.bincount(data.group, left) / np.maximum(np.bincount(data.group), 1)
    own = (left - gain[data.group]) / noise.own_std
    _, setting = np.unique(settings(data), axis=0, return_inverse=True)
    by_setting = _means(own, setting.ravel())
    part = np.zeros(data.count, int)
    for rows in rows_in_order(data):
        part[rows] = np.arange(rows.size) * PARTS // rows.size
    friction = data.of(FRICTION)
    by_part = _means(own[friction], (part + PARTS * data.driven)[friction], 2 * PARTS)
    gains = [np.mean(left[data.of(witness)]) for witness in data.witnesses]
    return np.concatenate([by_setting, by_part, gains, fitted])


def _means(values: Array, groups: Array, count: int = 0) -> Array:
    """Means of groups in standard deviations of a mean, of `values` of unit variance."""
    total = np.bincount(groups, values, minlength=count)
    return total / np.sqrt(np.maximum(np.bincount(groups, minlength=count), 1))


def beside_base(predictor: Predictor, noise: Noise, values: Array) -> tuple[Array, Array]:
    """What the base model leaves [n], and its parameters in prior units, by Gauss-Newton."""
    size = len(predictor.free)
    at = np.zeros(size)
    for _ in range(STEPS):
        near = predictor.predicted((), np.vstack([at, at + SMALL * np.eye(size)]))
        left = noise.whiten(np.nan_to_num(predictor.less(values, near[0])))
        slope = noise.whiten(np.nan_to_num(near[1:] - near[0]).T / SMALL)
        step = np.linalg.solve(slope.T @ slope + np.eye(size), slope.T @ left - at)
        step *= min(1.0, LONGEST / max(float(np.abs(step).max()), 1e-12))
        at = np.clip(at + step, -FARTHEST, FARTHEST)
    return np.nan_to_num(predictor.less(values, predictor.predicted((), at[None])[0])), at
