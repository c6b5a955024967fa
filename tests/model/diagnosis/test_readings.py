"""A table that is read in a wrong unit is told as that, and gives no effect a name."""

import re
from dataclasses import replace

import numpy as np
import pytest

from model.diagnosis.data import read_measurements
from model.diagnosis.hypotheses import candidate
from model.diagnosis.model_fit import Problem
from model.diagnosis.noise import noise_of
from model.diagnosis.priors import LOG_ODDS
from model.diagnosis.readings import READINGS, other_readings
from model.diagnosis.setting import Setting, otherwise_read
from model.diagnosis.space import Predictor
from model.diagnosis.witness import FRICTION
from model.diagnosis.workflow import diagnose
from model.support.tables import Named
from tests.fingers import FINGER
from tests.model.diagnosis.electrode import hidden, measured


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Nothing but leads is hidden."""
    path = tmp_path_factory.mktemp("readings") / "data.csv"
    measured(path, hidden(), 5)
    return path


@pytest.fixture(scope="module")
def data(path):
    return read_measurements(path)


def logs(data):
    """log evidence that nothing is missing, of the data as they are and as they may be meant."""
    problem = Problem(Predictor(FINGER, data), data.observed, noise_of(data))
    base = candidate(problem, (), problem.fit((), np.zeros(len(problem.predictor.free))))
    return base.alone.log_evidence, otherwise_read(FINGER, Setting(data, problem, base, [], ()))


# 0.25 N are 250 of these, which no table may hold
READABLE = [one for one in READINGS if one.said != "loads in mN"]


@pytest.mark.parametrize("reading", READABLE, ids=lambda reading: reading.said)
def test_what_a_table_is_read_as_is_told_from_what_it_says(data, reading):
    there = {name: factor for name, factor in reading.factors.items() if name in data.columns}
    as_written = {name: data.columns[name] / factor for name, factor in there.items()}
    as_it_is, others = logs(replace(data, columns=data.columns | as_written))
    right = others.pop(reading.name)
    assert right - max(as_it_is, *others.values()) > 2.0 * LOG_ODDS


def test_a_table_that_is_read_rightly_is_not_doubted(data):
    as_it_is, others = logs(data)
    assert len(others) >= 10
    assert as_it_is - max(others.values()) > LOG_ODDS


def test_what_no_table_may_hold_is_no_reading(data):
    said = {one.said for one in other_readings(data)}
    assert "loads in mN" not in said
    assert "phases that count the other way" in said
    friction = data.subset(data.of(FRICTION))
    columns = {n: c for n, c in friction.columns.items() if "current" not in n}
    few = {one.said for one in other_readings(replace(friction, columns=columns))}
    assert "currents in mA" not in few


def test_nobody_asks_for_the_units_of_what_this_program_measured(path, data, tmp_path):
    header, *rows = path.read_text(encoding="utf-8").splitlines()
    own = tmp_path / "own.csv"
    own.write_text("\n".join([f"{header},simulated", *(f"{row},true" for row in rows)]))
    assert other_readings(read_measurements(own)) == []
    assert other_readings(data)


def test_frequencies_in_khz_are_no_wet_skin(path, tmp_path):
    """They were skin hydration with a probability of 0.996."""
    header, *rows = path.read_text(encoding="utf-8").splitlines()
    cells = [row.split(",")[:7] for row in rows if row.split(",")[5]]
    in_khz = tmp_path / "khz.csv"
    lines = [",".join([f"{float(f) / 1e3:g}", *rest]) for f, *rest in cells]
    in_khz.write_text("\n".join([",".join(header.split(",")[:7]), *lines]))
    found = diagnose(FINGER, read_measurements(in_khz))
    assert found.name == "unexplained"
    (said,) = found.findings.verdict.posterior.looks_like
    assert said in found.findings.verdict.reason
    assert said.startswith("a table with frequencies in kHz looks like this: look at the file")
    unit = "--column frequency_hz=NAME:"
    assert said.endswith(f"if so, {unit}1000Hz, if not, {unit}Hz (NAME: in the file)")
    assert found.findings.learned is None
    named = {"frequency_hz": Named("frequency_hz", "1000Hz")}
    assert diagnose(FINGER, read_measurements(in_khz, named=named)).name == "no_discrepancy"
    named = {"frequency_hz": Named("frequency_hz", "Hz")}
    said = {one.said for one in other_readings(read_measurements(in_khz, named=named))}
    assert "voltages that are rms" in said
    assert not any("frequencies" in one for one in said)


def test_a_reading_says_how_to_give_the_unit(path):
    """Each of these texts is a unit that `--column` takes."""
    for reading in READINGS:
        so = re.search(r"if so, --column (\w+)=\w+:(\S+),", reading.check)
        column, unit = so.groups()
        (name, factor), *_ = reading.factors.items()
        assert column == name
        if name in ("frequency_hz", "current_a", "current_phase_rad", "voltage_v"):
            read = read_measurements(path, True, {name: Named(column, unit)}).columns[name]
            expected = factor * read_measurements(path).columns[name]
            assert read == pytest.approx(expected, rel=1e-5, nan_ok=True)
