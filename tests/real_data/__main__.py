"""`make real-data DATA=folder`: what must hold on measured data of a film on brass.

The project ships none of these data; docs/real-data.md says where they are from, and what the
folder holds.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

from haptic_driver.lab.challenge.answers import AXES, Answer, read_answers
from model.description import read_model
from model.diagnosis.data import Measurements, read_measurements
from model.diagnosis.priors import words
from model.diagnosis.witness import FRICTION
from model.diagnosis.workflow import Diagnosis, Findings, diagnose

MODEL = "clutch.toml"
KINETIC, OVER_TIME, PEAK = "kinetic", "over time", "peak"
WITH_MONITOR = "peak, with the monitor"
FILES = {
    KINETIC: "clutch_kinetic.csv",
    OVER_TIME: "clutch_time.csv",
    PEAK: "clutch_static_voltage_monitor.csv",
    WITH_MONITOR: "clutch_static_voltage_monitor.csv",
}
DIRECT_HZ = 0.16  # as which these files write direct voltage
BEFORE, AFTER = "#c44e52", "#4c72b0"


class Check(NamedTuple):
    """What must hold, whether it does, and what came out."""

    must: str
    holds: bool
    found: str


def read(folder: Path, name: str) -> Measurements:
    """One of the data sets; rows that cannot be used are left out, and counted by the report."""
    data = read_measurements(folder / FILES[name], leave_out_bad=True)
    return data.subset(data.of(FRICTION)) if name == PEAK else data


def direct_place(found: Findings) -> int | None:
    """The rank of the first place that holds direct voltage alone, from 1."""
    for rank, region in enumerate(found.before.regions, start=1):
        if "frequency_hz" in region.axes:
            at = region.axes.index("frequency_hz")
            if region.high[at] <= DIRECT_HZ:
                return rank
    return None


def checks(diagnoses: dict[str, Diagnosis]) -> list[Check]:
    """Everything that must hold."""
    said = {name: each.name for name, each in diagnoses.items()}
    table = [
        Check(f"{name}: can be tested", verdict != "not_testable", verdict)
        for name, verdict in said.items()
    ]
    for name in (PEAK, WITH_MONITOR):
        found = diagnoses[name].findings
        named = () if found is None else found.verdict.decision.names
        given = " and ".join(words(n) for n in named) or "none"
        table.append(Check(f"{name}: no effect is named", said[name] != "effect_found", given))
    over_time = diagnoses[OVER_TIME].findings
    rank = None if over_time is None else direct_place(over_time)
    found_at = "not among the places" if rank is None else f"place {rank}"
    table.append(Check(f"{OVER_TIME}: direct voltage is the first place", rank == 1, found_at))
    return table


def answers_checks(answers: dict[str, Answer]) -> list[Check]:
    """The same of somebody's answers, as in a challenge: by place and abstention alone."""
    peak, over_time = (answers.get(FILES[name], Answer()) for name in (PEAK, OVER_TIME))
    abstains = peak.verdict not in (None, "named")
    first = (over_time.where or [{}])[0]
    high_hz = first.get("frequency_hz", [0.0, np.inf])[1]
    return [
        Check(f"{PEAK}: no effect is named", abstains, peak.verdict or "no answer"),
        Check(
            f"{OVER_TIME}: direct voltage is the first place",
            high_hz <= DIRECT_HZ,
            str(first) if first else "no place",
        ),
    ]


def told(name: str, each: Diagnosis, cpu_s: float) -> str:
    """What came out of one data set, on a line."""
    found = each.findings
    if found is None:
        return f"{name}: {each.name}"
    likely = list(found.verdict.posterior.inclusion.items())[:3]
    leading = ", ".join(f"{words(n)} {p:.2f}" for n, p in likely)
    low, high = found.proof.interval
    closed = f"gap closed {found.proof.gap_closed:.2f} ({low:.2f} to {high:.2f})"
    return (
        f"{name}: {each.data.count} observations, {each.name}; {leading}; {closed}; {cpu_s:.0f} s"
    )


def draw(diagnoses: dict[str, Diagnosis], out: Path) -> list[Path]:
    """Where measured friction lies beside the model's, and held-out errors by day."""
    mpl.rcParams["svg.hashsalt"] = "real-data"
    out.mkdir(parents=True, exist_ok=True)
    tested = {n: d for n, d in diagnoses.items() if d.findings is not None}
    drawers = (("real-data-gap.svg", _gap), ("real-data-held-out.svg", _held_out))
    paths = []
    for name, on_axes in drawers:
        figure, axes = plt.subplots(1, len(tested), figsize=(13.0, 3.4), layout="constrained")
        for ax, (title, each) in zip(np.atleast_1d(axes), tested.items(), strict=True):
            assert each.findings is not None
            on_axes(ax, each, each.findings)
            ax.set_title(title, fontsize=10)
        np.atleast_1d(axes)[0].legend(fontsize=8)
        paths.append(out / name)
        figure.savefig(paths[-1], metadata={"Date": None})
        plt.close(figure)
    return paths


def _gap(ax: plt.Axes, each: Diagnosis, found: Findings) -> None:
    """Median and middle half of measured over predicted friction at each frequency."""
    data, predictor = each.data, found.problem.predictor
    mine = data.of(FRICTION) & data.driven
    at_hz = data.columns["frequency_hz"][mine]
    models = (
        ("model as given", BEFORE, found.hypotheses.base.fit, 0.94),
        (words(found.chosen.name), AFTER, found.chosen.fit, 1.06),
    )
    for label, colour, fit, shift in models[: 2 if found.chosen.kinds else 1]:
        left = data.observed - predictor.predicted(fit.kinds, fit.vector[None])[0]
        ratio = np.exp(left[mine])
        levels = np.unique(at_hz)
        low, middle, high = np.array(
            [np.percentile(ratio[at_hz == f], [25.0, 50.0, 75.0]) for f in levels]
        ).T
        reach = (middle - low, high - middle)
        ax.errorbar(shift * levels, middle, reach, fmt="o", ms=4, color=colour, label=label)
    ax.axhline(1.0, color="0.4", lw=0.8, ls="--")
    ax.set(xscale="log", xlabel="frequency / Hz (0.16: direct)", ylabel="measured / predicted")


def _held_out(ax: plt.Axes, _: Diagnosis, found: Findings) -> None:
    """Squared error per point on each day that no fit has seen."""
    proof, at = found.proof, np.arange(len(found.proof.folds))
    ax.bar(at - 0.2, proof.before, 0.38, color=BEFORE, label="model as given")
    ax.bar(at + 0.2, proof.after, 0.38, color=AFTER, label="what was chosen without the day")
    ax.axhline(1.0, color="0.2", lw=0.8, ls="--", label="noise alone")
    ax.set_xticks(at, proof.folds, fontsize=7)
    ax.set_ylabel("squared error / noise")


def missing(folder: Path) -> list[str]:
    """Files that the folder lacks."""
    return [
        name for name in dict.fromkeys((MODEL, *FILES.values())) if not (folder / name).exists()
    ]


def main() -> int:
    """Diagnose each data set, print the table; 1 where something does not hold, 2 without data."""
    parser = argparse.ArgumentParser(description="What must hold on data that nobody here made.")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=Path("out/real-data"))
    parser.add_argument("--answers", type=Path, help="somebody's, instead of diagnoses")
    asked = parser.parse_args()
    if asked.answers is not None:
        columns = dict.fromkeys(FILES.values(), AXES)
        return _printed(answers_checks(read_answers(asked.answers, columns)))
    if lacking := missing(asked.data):
        print(
            f"{asked.data}: {', '.join(lacking)} not there. The project ships no such data;"
            " docs/real-data.md says where they are from: make real-data DATA=folder",
            file=sys.stderr,
        )
        return 2
    model, diagnoses = read_model(asked.data / MODEL), dict[str, Diagnosis]()
    for name in FILES:
        began_s = time.process_time()
        diagnoses[name] = diagnose(model, read(asked.data, name))
        print(told(name, diagnoses[name], time.process_time() - began_s), flush=True)
    for path in draw(diagnoses, asked.out):
        print(f"picture: {path}")
    return _printed(checks(diagnoses))


def _printed(table: list[Check]) -> int:
    """Print it; 1 where something does not hold."""
    for check in table:
        print(f"{'holds' if check.holds else 'DOES NOT HOLD':14} {check.must} ({check.found})")
    return int(not all(check.holds for check in table))


if __name__ == "__main__":
    sys.exit(main())
