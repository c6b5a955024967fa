"""Data, and what they say about a model: a diagnosis, an investigation, a calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np

from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.files import bad_input, require_ending, writing
from haptic_driver.lab.measured import measurements_of
from haptic_driver.lab.measuring import recordings
from haptic_driver.lab.measuring.investigate import Budget, Investigation, Subject
from haptic_driver.lab.measuring.investigate import investigate as run_investigation
from haptic_driver.lab.measuring.plan import load_plan
from haptic_driver.lab.psychophysics.fit import Fit, fit
from haptic_driver.lab.psychophysics.functions import Form
from haptic_driver.lab.trials import TrialRows
from haptic_driver.lookup.models import load_model
from haptic_driver.public.given import bad_given, is_table
from haptic_driver.public.picture import Picture
from haptic_driver.recording.read import Run, read_run
from haptic_driver.rig.config import load_rig
from model.analysis import calibration
from model.description import ModelDescription
from model.diagnosis import workflow
from model.diagnosis.data import COLUMNS, Measurements
from model.reporting.model_file import fitted_model
from model.reporting.pictures import pictures
from model.reporting.report import report, write_report
from model.support.errors import nearest

__all__ = [
    "calibrate",
    "diagnose",
    "fit_psychometric",
    "investigate",
    "read_data",
    "read_recording",
]


@dataclass(frozen=True)
class Diagnosis:
    """What the data say is missing from a model, or that nothing is.

    `verdict` is one of no_discrepancy, effect_found, ambiguous, unexplained, not_testable.
    """

    found: workflow.Diagnosis
    description: ModelDescription

    @property
    def verdict(self) -> str:
        """The verdict in one word, as `haptic diagnose --json` gives it."""
        return self.found.name

    @cached_property
    def report(self) -> dict[str, Any]:
        """The whole report: the JSON of `haptic diagnose`."""
        return report(self.found, self.description, "")

    @property
    def effects(self) -> list[str]:
        """Names of the effects that were found."""
        return [effect["name"] for effect in self.report["effects"]]

    @property
    def model(self) -> ModelDescription:
        """The model fitted to the data, with the effects that were found."""
        return fitted_model(self.found, self.description, "data")

    def plot(self, name: str = "probabilities") -> Picture:
        """One of the report's pictures (SVG); BadInputError for a name that it does not have."""
        drawn = pictures(self.found)
        if name not in drawn:
            raise BadInputError("bad_picture", f"no picture '{name}'", nearest(name, list(drawn)))
        return Picture(partial(_save_svg, drawn[name]), ".svg")

    def save(self, folder: Path | str) -> Path:
        """Write report.html, report.json, model.toml and pictures; returns the page."""
        with writing(Path(folder)):
            write_report(self.found, self.description, Path(folder), "data")
        return Path(folder) / "report.html"

    def __str__(self) -> str:
        return f"{self.verdict}: {'; '.join(self.report['reasons'])}"


def _save_svg(content: bytes, path: Path) -> None:
    require_ending(path, [".svg"])
    with writing(path):
        path.write_bytes(content)


def read_data(*paths: Path | str, leave_out_bad: bool = False) -> Measurements:
    """Read files of measured data (CSV) and recordings (HDF5) as one data set.

    BadInputError with every row that cannot be used; `leave_out_bad` goes on without those rows.
    """
    return recordings.read_data([Path(path) for path in paths], leave_out_bad=leave_out_bad)


def _measured(data: Any) -> Measurements:
    """Data as they are given: read already, a file, rows of trials, or a table in memory."""
    if isinstance(data, Measurements):
        return data
    if isinstance(data, TrialRows):
        return measurements_of(data.rows, COLUMNS)
    return measurements_of(data, COLUMNS) if is_table(data) else read_data(data)


def diagnose(data: Any, model: ModelDescription | str = "reference", seed: int = 0) -> Diagnosis:
    """Find where data and model disagree, and which effect is missing.

    `data`: a file, what `read_data` or `read_rows` gave, a pandas DataFrame, or a dict of arrays,
    with units by name or pint.
    """
    measured = _measured(data)
    description = load_model(model) if isinstance(model, str) else model
    return Diagnosis(workflow.diagnose(description, measured, seed), description)


def fit_psychometric(
    level: Sequence[float], positive: Sequence[bool], form: str, guess: float | None
) -> Fit:
    """Fit a psychometric function to the answers of one condition, one entry per trial.

    `positive`: whether each was the answer that grows with the level, as True or False, 1 or 0.
    `form`: weibull or normal. `guess`: the share by chance, or None to fit it too. BadInputError
    for answers that are none, and where there are too few.
    """
    with bad_given("bad_answers", "level"):
        levels = np.asarray(level, dtype=np.float64)
    answers = np.asarray(positive)
    forms = list(get_args(Form))
    if form not in forms:
        raise BadInputError("bad_form", f"there is no form '{form}'", nearest(form, forms))
    if answers.shape != levels.shape or levels.ndim != 1 or not np.isfinite(levels).all():
        said = f"level has the shape {levels.shape}, positive {answers.shape}"
        raise BadInputError("bad_answers", said, "Give a finite level and an answer a trial")
    if answers.dtype.kind not in "biuf" or not np.isin(answers, (0, 1)).all():
        odd = next(a for a in answers.tolist() if a not in (0, 1))
        hint = "Give True or False, 1 or 0: the answer that grows with the level is True"
        raise BadInputError("bad_answers", f"{odd!r} is no answer", hint)
    return fit(levels.tolist(), answers.astype(bool).tolist(), cast(Form, form), guess)


def investigate(
    rig: str,
    model: ModelDescription | str = "reference",
    out: Path | str = "investigation",
    minutes: float = 60.0,
    rounds: int = 4,
    seed: int = 0,
) -> Investigation:
    """Measure, diagnose and measure again on a simulated rig, until an effect is named.

    It also ends when nothing is missing, nothing more can be separated, or `minutes` of measuring
    or `rounds` are over. HapticError for a real rig, at which somebody must be present: use
    `haptic investigate`.
    """
    config = load_rig(rig)
    if not config.simulated:
        raise HapticError("real_rig", f"rig {rig} is real", "Use the command: haptic investigate")
    description = load_model(model) if isinstance(model, str) else model
    subject = Subject(config, description, load_plan("witnesses"), seed=seed)
    return run_investigation(subject, Path(out), Budget(rounds, minutes))


def calibrate(data: Any, model: ModelDescription | str = "reference") -> calibration.Calibration:
    """Fit a finger's own numbers to its data, as `diagnose` takes them; `.model` has them."""
    measured = _measured(data)
    description = load_model(model) if isinstance(model, str) else model
    with bad_input("bad_data"):
        return calibration.calibrate(description, measured)


def read_recording(path: Path | str, run: str | None = None) -> Run:
    """Read one run of a recording, the last unless named; `.to_frame()` makes a table of it."""
    return read_run(Path(path), run)
