"""Interventions in data, and which blocks of settings are chosen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from model.conditions import Conditions
from model.diagnosis.data import Measurements, read_measurements
from model.diagnosis.space import Predictor
from model.diagnosis.workflow import diagnose
from model.effects import BY_NAME
from model.planning.design import Pool, design_for_unseen
from model.planning.discrimination import (
    Information,
    Pair,
    by_all,
    by_block,
    information_of,
    most_by_one,
    nothing,
)
from model.planning.separation import APART
from model.touch_model import TouchModel
from tests.fingers import FINGER, hiding

HUMID = BY_NAME["humid_gap_conduction"]
HEADER = "frequency_hz,voltage_v,normal_force_n,cof,cof_std,intervention"


def read(path: Path, header: str, *lines: str) -> Measurements:
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    return read_measurements(path)


def test_an_intervention_takes_its_effects_away_in_its_rows(tmp_path):
    """Against the model's own friction, with the effect where nothing removes it and without in the
    other row.
    """
    data = read(
        tmp_path / "a.csv",
        HEADER,
        "50,75,0.5,0.6,0.01,",
        "50,75,0.5,0.6,0.01,dry_air",
        "50,75,0.5,0.6,0.01,wipe",
    )
    got = Predictor(FINGER, data, ()).predicted([HUMID], np.array([[1.0]]))[0]
    conditions = Conditions(np.array([50.0]), np.array([75.0]), np.array([0.5]))
    (parameter,) = HUMID.parameters()
    value = float(parameter.from_normal(np.asarray(1.0)))
    wet = hiding(FINGER, **{HUMID.name: {parameter.name: value}})
    without, with_it = (
        float(np.log(TouchModel(m).predict(conditions).cof[0])) for m in (FINGER, wet)
    )
    assert abs(with_it - without) > 0.01
    np.testing.assert_allclose(got, [with_it, without, with_it], rtol=1e-9)


def test_an_unknown_intervention_is_refused(tmp_path):
    with pytest.raises(Exception, match="line 2: intervention 'drying' is unknown"):
        read(tmp_path / "a.csv", HEADER, "50,75,0.5,0.6,0.01,drying", "50,75,0.5,0.6,0.01,")


def test_where_nothing_shows_it_is_looked_where_something_may_be_unseen(tmp_path):
    """Friction at low frequencies cannot show a slow amplifier; at 100 kHz it can, and without
    voltage nothing can.
    """
    c = Conditions(
        np.tile([50.0, 100.0], 8),
        np.repeat([0.0, 60.0, 75.0, 110.0], 4),
        np.tile([0.25, 0.25, 1.0, 1.0], 4),
    )
    cof = TouchModel(FINGER).predict(c).cof * np.exp(
        0.01 * np.random.default_rng(3).normal(size=16)
    )
    rows = zip(c.frequency_hz, c.voltage_v, c.normal_force_n, cof, 0.01 * cof, strict=True)
    text = [",".join(map(str, row)) for row in rows]
    seen = diagnose(
        FINGER, read(tmp_path / "a.csv", "frequency_hz,voltage_v,normal_force_n,cof,cof_std", *text)
    )
    assert seen.name == "no_discrepancy"
    columns = {
        "frequency_hz": np.array([100.0, 100.0, 100.0, 1e5]),
        "voltage_v": np.array([0.0, 0.0, 0.0, 110.0]),
        "normal_force_n": np.full(4, 0.5),
    }
    to_come = Measurements(columns, np.zeros(4, np.intp), ("next",), None, "")
    pool = Pool(to_come, np.array([0, 0, 1, 1]), np.ones(2), 3)
    chosen = design_for_unseen(seen, pool, 1, 1.0)
    assert [choice.block for choice in chosen.choices] == [1]
    assert chosen.reach["amplifier_bandwidth"] > APART
    every = design_for_unseen(seen, pool, 9, 9.0).choices
    assert len({choice.block for choice in every}) == len(every)  # once is enough


def test_rows_that_contradict_kramers_and_kronig_are_left_out(tmp_path):
    header = (
        "frequency_hz,voltage_v,normal_force_n,current_a,current_phase_rad,finger,kramers_kronig"
    )
    lines = [
        f"{f},5,0.5,1e-5,0.5,resting,{said}"
        for f, said in ((1e2, "passes"), (1e3, "fails"), (1e4, ""))
    ]
    data = read(tmp_path / "a.csv", header, *lines)
    assert sorted(set(data.columns["frequency_hz"])) == [1e2, 1e4]
    assert data.left_out == 1


def pair(
    rng: np.random.Generator, blocks: int, rows: int, size: int
) -> tuple[Pair, list[tuple[np.ndarray, np.ndarray]]]:
    raw = [(rng.normal(size=(rows, size)), rng.normal(size=rows)) for _ in range(blocks)]
    told = Information(
        np.array([u.T @ u for u, _ in raw]),
        np.array([u.T @ d for u, d in raw]),
        np.array([d @ d for _, d in raw]),
    )
    return Pair(("a", "b"), 1.0, told, nothing(size)), raw


def test_the_separation_is_that_of_the_covariance():
    """d' (1 + U U')^-1 d of everything measured, worked out in the space of the observations."""
    rng = np.random.default_rng(3)
    found, raw = pair(rng, 4, 7, 3)

    def direct(which: list[int]) -> float:
        u, d = (
            np.concatenate([raw[b][0] for b in which]),
            np.concatenate([raw[b][1] for b in which]),
        )
        return float(d @ np.linalg.solve(np.eye(d.size) + u @ u.T, d))

    assert found.reach() == pytest.approx(direct([0, 1, 2, 3]))
    added = found.choose(2)
    assert added == pytest.approx(direct([2]))
    assert added + found.choose(0) == pytest.approx(direct([2, 0]))
    several = (found.information + found.blocks[np.array([1, 3])]).chi2()
    np.testing.assert_allclose(several, [direct([2, 0, 1]), direct([2, 0, 3])])


def test_several_differences_are_told_as_each_alone():
    rng = np.random.default_rng(7)
    differences, spread, block = (
        rng.normal(size=(3, 12)),
        rng.normal(size=(12, 2)),
        np.repeat([0, 1, 2], 4),
    )
    so_far = nothing(2) + information_of(rng.normal(size=(3, 5)), rng.normal(size=(5, 2)))
    best, together = most_by_one(so_far, by_block(differences, spread, block, 3)), []
    for i, difference in enumerate(differences):
        alone = Pair(("a", "b"), 1.0, by_block(difference, spread, block, 3), so_far_of(so_far, i))
        assert best[i] == pytest.approx(
            max((alone.information + alone.blocks[b]).chi2() for b in range(3))
        )
        together.append(alone.reach())
    np.testing.assert_allclose(by_all(so_far, by_block(differences, spread, block, 3)), together)


def so_far_of(so_far: Information, i: int) -> Information:
    return Information(so_far.normal, so_far.moment[i], so_far.square[i])


def test_what_a_parameter_hides_in_the_data_so_far_more_of_the_same_does_not_show():
    """Friction that has aged long ago was expected to show in any further row, as if the finger
    were known by then.
    """
    rng = np.random.default_rng(11)
    seen, to_come = rng.normal(size=(200, 1)), rng.normal(size=(60, 1))
    moved = 1.3  # of the parameter, in standard deviations of what is known of it
    pair = Pair(
        ("none", "ageing"),
        1.0,
        by_block(moved * to_come[:, 0], to_come, np.arange(60), 60),
        nothing(1) + information_of(moved * seen[:, 0], seen),
    )
    assert pair.reached <= pair.reach() <= moved**2
