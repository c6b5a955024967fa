"""Others beside the diagnosis: what they are asked, and how what they say is counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from model.description import read_model
from model.diagnosis.data import read_measurements
from model.diagnosis.witness import VOLTAGE

from . import classifier
from .evaluate import MODEL
from .generator import build, witnesses
from .generator.__main__ import csv_text
from .peers import peers_table
from .scores import Answer, Guess

GAIN, NOTHING = (("drive_gain_error", 1000.0),), ()


def written(folder: Path, hidden: list[tuple]) -> list[Path]:
    """A set with all witnesses for each, and the first one's friction alone."""
    paths = []
    for index, effects in enumerate(hidden):
        spec = build.Spec("W1", index, effects, design="witnesses")
        every, friction = witnesses.build_pair(spec, 4)
        for name, one in (("all", every), ("friction", friction))[: 1 + (index == 0)]:
            paths.append(folder / f"{index}-{name}.csv")
            paths[-1].write_text(csv_text(one.columns))
    return paths


@pytest.fixture(scope="module")
def few(tmp_path_factory):
    return written(tmp_path_factory.mktemp("sets"), [NOTHING, NOTHING, GAIN])


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    return written(tmp_path_factory.mktemp("sets"), [NOTHING] * (classifier.FEWEST - 1) + [GAIN])


def test_the_base_model_is_fitted_before_features_are_taken(few):
    """What the base model itself predicts leaves nothing, and its parameters come back."""
    template = classifier.template(read_model(MODEL), read_measurements(few[0]))
    vector = np.random.default_rng(1).normal(size=len(template.predictor.free))
    values = template.predictor.predicted((), vector[None])[0]
    left, fitted = classifier.beside_base(template.predictor, template.noise, values)
    assert np.abs(left / template.noise.own_std).max() < 0.5
    assert fitted[0] == pytest.approx(vector[0], abs=0.1)  # held by rows without voltage


def test_features_tell_a_gain_error_from_nothing(few):
    """The electrode's voltage shows the whole gain, and none where none is hidden."""
    description = read_model(MODEL)
    files = [read_measurements(path) for path in few if "all" in path.name]
    templates = [classifier.template(description, data) for data in files]
    rows = np.array([classifier.features(template) for template in templates])
    witnesses_seen = len(templates[0].data.witnesses)
    fitted = len(templates[0].predictor.free)
    voltage = rows[:, -fitted - witnesses_seen :][:, VOLTAGE]
    assert np.abs(voltage[:-1]).max() < 0.03  # gains of 1 % from two or three sessions
    assert np.abs(voltage[-1]) > 0.1


@pytest.mark.soak
@pytest.mark.timeout(600)
def test_a_classifier_names_a_gain_error_and_nothing_where_nothing_is_hidden(paths):
    pytest.importorskip("sklearn")
    answers, _ = classifier.classified(read_model(MODEL), paths)
    *nothing, gain = (guess.name for _, guess in sorted(answers.items()))
    assert gain == GAIN[0][0]
    assert nothing.count("none") >= len(nothing) - 1


def label(*names: str, stranger: bool = False) -> dict:
    effects = [{"name": name, "lambda": 100.0, "stranger": stranger} for name in names]
    return {"witnesses": "all", "effects": effects}


def answer(names: tuple[str, ...], aicc: str) -> Answer:
    verdict = "effect_found" if names else "no_discrepancy"
    return Answer(verdict, names, (), "none", 0.9, aicc, "none")


def cells(table: str, row: str) -> list[str]:
    (line,) = (line for line in table.splitlines() if line.startswith(f"| {row}"))
    return [cell.strip().split(", ")[-1] for cell in line.split("|")[2:-1]]


def test_names_are_counted_for_every_method():
    labels = {"1": label("a"), "2": label("a", "b"), "3": label("odd", stranger=True), "4": label()}
    answers = {
        "1": answer(("a",), "b"),
        "2": answer(("a", "b"), "b"),
        "3": answer((), "a"),
        "4": answer((), "none"),
    }
    guesses = {"1": Guess("a", 0.5), "3": Guess("none", 0.99)}
    table = peers_table(answers, labels, guesses, ["a note"])
    # diagnosis, AICc, BIC, trees, trees where they are sure
    assert cells(table, "sets answered") == ["4", "4", "4", "2", "2"]
    assert cells(table, "visible single") == ["1/1", "0/1", "0/1", "1/1", "0/1"]
    assert cells(table, "wrong name") == ["0/4", "2/4", "0/4", "0/2", "0/2"]
    assert cells(table, "nothing hidden") == ["0/1", "0/1", "0/1", "-", "-"]
    assert cells(table, "visible strangers") == ["0/1", "1/1", "0/1", "0/1", "0/1"]
    assert cells(table, "two visible") == ["1/1", "0/1", "0/1", "-", "-"]
    assert cells(table, "the same, one named") == ["0/1", "1/1", "0/1", "-", "-"]
