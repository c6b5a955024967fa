"""Population studies: many fingers times screens and models -> surfaces, what each can reach, and
how that spreads.

Every task (one finger at one combination of levels) is a pure function of the plan and its number.
So it gives the same numbers on this machine and on a cluster. Each finished task is one line of
`tasks.jsonl`; a study that was stopped goes on after the last whole line.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import product
from math import inf
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, FiniteFloat

from haptic_driver.config import Checked, find_config, parse
from haptic_driver.errors import BadInputError, HapticError, optional
from haptic_driver.files import open_to_add, whole_lines, write_rows, write_text, write_through
from haptic_driver.limits import OperatingLimits
from haptic_driver.lookup.build import SurfaceAxes, build_surface
from haptic_driver.lookup.file import SurfaceFile, ready_for_lookup
from haptic_driver.lookup.models import load_model
from haptic_driver.processes.started import start_workers
from haptic_driver.render.controller import Controller, ControllerSettings
from haptic_driver.render.surface import NO_CAPS, invert
from haptic_driver.rig.config import load_rig
from haptic_driver.signals import Array
from model.conditions import Conditions
from model.description import ModelDescription
from model.diagnosis.space import FINGER
from model.parameters import SPECIFICATION
from model.support.errors import nearest
from model.support.reading import read_toml
from model.touch_model import TouchModel

MOST_TASKS = 1_000_000
MOST_STD = 2.5  # a drawn finger lies no further out, so that none is impossible
BETWEEN_FINGERS = {n.name: n.log_std for n in FINGER if n.name != "cof_off"}
TASKS, TABLE, SURFACES = "tasks.jsonl", "fingers.csv", "surfaces"
ANSWER_S = 20.0  # of a cluster's scheduler, and of a first worker
NUMBERS = (
    "cof",
    "electrostatic_force_n",
    "current_rms_a",
    "reachable_low",
    "reachable_high",
    "share_pulled_in",
)
PERCENTILES = (5, 25, 50, 75, 95)


class _Grid(Checked):
    """Points of each finger's surface."""

    frequency_count: Annotated[int, Field(ge=4, le=400)] = Field(
        default=61, description="points along frequency"
    )
    voltage_count: Annotated[int, Field(ge=4, le=400)] = Field(
        default=61, description="points along voltage"
    )
    normal_force_count: Annotated[int, Field(ge=4, le=40)] = Field(
        default=5, description="points along normal force"
    )


class _At(Checked):
    """The condition at which every finger is compared."""

    frequency_hz: Annotated[FiniteFloat, Field(ge=1.0, le=1e6)] = Field(
        default=250.0, description="where fingers are compared"
    )
    voltage_v: Annotated[FiniteFloat, Field(gt=0.0, le=1000.0)] = Field(
        default=75.0, description="where fingers are compared"
    )
    normal_force_n: Annotated[FiniteFloat, Field(ge=0.1, le=2.0)] = Field(
        default=0.5, description="where fingers are compared"
    )


class StudyPlan(Checked):
    """A study as its file says."""

    name: str = Field(description="written into the results")
    about: str = Field(default="", description="in words")
    model: str = Field(default="reference", description="by name or path")
    rig: str = Field(default="simulated", description="by name or path; its limits apply")
    fingers: Annotated[int, Field(ge=1)] = Field(description="how many are drawn")
    seed: Annotated[int, Field(ge=0)] = Field(default=1, description="of the draws")
    spread: dict[str, Annotated[FiniteFloat, Field(ge=0.0, le=2.0)]] = Field(
        default=BETWEEN_FINGERS,
        description=(
            "standard deviation of the logarithm of each number that differs between fingers"
        ),
    )
    levels: dict[str, Annotated[list[FiniteFloat], Field(min_length=1)]] = Field(
        default={},
        description=(
            "numbers of the model set to each of several values, in every "
            "combination, for every finger"
        ),
    )
    surface: _Grid = _Grid()
    at: _At = _At()
    keep_surfaces: bool = Field(default=False, description="write every finger's surface")

    @property
    def combinations(self) -> list[dict[str, float]]:
        """Every combination of the levels."""
        return [
            dict(zip(self.levels, values, strict=True)) for values in product(*self.levels.values())
        ]

    @property
    def count(self) -> int:
        """Number of tasks: combinations run fastest."""
        return self.fingers * len(self.combinations)


@dataclass(frozen=True)
class Study:
    """A plan with everything it names loaded: what a worker needs, wherever it runs."""

    plan: StudyPlan
    description: ModelDescription
    limits: OperatingLimits
    controller: dict[str, Any]

    @property
    def content_hash(self) -> str:
        """Equal where every task gives the same numbers."""
        said = [
            self.plan.model_dump_json(exclude={"about"}),
            self.description.content_hash,
            repr(self.limits),
        ]
        return hashlib.sha256(
            json.dumps([*said, self.controller], sort_keys=True).encode()
        ).hexdigest()[:16]

    def finger(self, number: int) -> dict[str, float]:
        """The numbers of one finger, the same for every combination of levels."""
        rng = np.random.default_rng([self.plan.seed, number])
        drawn = {}
        for name, log_std in sorted(self.plan.spread.items()):
            x = float(np.clip(rng.standard_normal(), -MOST_STD, MOST_STD))
            drawn[name] = self.description.parameters[name].value * float(np.exp(log_std * x))
        return drawn

    def run(self, task: int, out: Path | None = None) -> dict[str, Any]:
        """One task: the surface of one finger at one combination of levels, and what it can reach.

        Writes the surface under `out` where the plan keeps surfaces.
        """
        combinations = self.plan.combinations
        finger = task // len(combinations)
        values = self.finger(finger) | combinations[task % len(combinations)]
        own = self.description.parameters
        changed = {name: replace(own[name], value=value) for name, value in values.items()}
        description = replace(self.description, parameters=own | changed)
        axes = SurfaceAxes(voltage_high_v=self.limits.voltage_v, **self.plan.surface.model_dump())
        file = build_surface(description, self.limits, axes)
        if out is not None and self.plan.keep_surfaces:
            file.write(out / SURFACES / f"{task:06d}.h5")
        return {
            "task": task,
            "finger": finger,
            "values": values,
            **self._measured(description, file),
        }

    def _measured(self, description: ModelDescription, file: SurfaceFile) -> dict[str, Any]:
        at = self.plan.at
        point = Conditions(
            *(np.array([x]) for x in (at.frequency_hz, at.voltage_v, at.normal_force_n))
        )
        answer = TouchModel(description).predict(point)
        lookup = ready_for_lookup(file, self.limits)
        low, high = Controller(
            ControllerSettings(lookup, self.limits, **self.controller)
        ).reachable(at.normal_force_n)
        return {
            "cof": float(answer.cof[0]),
            "electrostatic_force_n": float(answer.electrostatic_force_n[0]),
            "current_rms_a": float(answer.current_rms_a[0]),
            "reachable_low": low,
            "reachable_high": high,
            "share_pulled_in": float(file.pulled_in.mean()),
            "highest_cof": [
                invert(lookup, inf, f, at.normal_force_n, NO_CAPS).cof
                for f in self.frequency_hz.tolist()
            ],
        }

    @property
    def frequency_hz(self) -> Array:
        """Where `highest_cof` of a task is given [f]."""
        return SurfaceAxes(frequency_count=self.plan.surface.frequency_count).frequency_hz


def load_study(name_or_path: str) -> Study:
    """A study by the name of its plan in `configs/populations/`, or by path; BadInputError says
    what is wrong where.
    """
    path = find_config(name_or_path, "populations")
    plan = parse(StudyPlan, read_toml(path), str(path))
    for name in (*plan.spread, *plan.levels):
        if name not in SPECIFICATION:
            hint = nearest(name, list(SPECIFICATION))
            raise BadInputError("unknown_key", f"{path}: the model has no number '{name}'", hint)
    for name, values in plan.levels.items():
        low, high = SPECIFICATION[name]["low"], SPECIFICATION[name]["high"]
        if not all(low <= value <= high for value in values):
            raise BadInputError(
                "bad_config", f"{path}: levels.{name} is out of range", f"Within {low:g}..{high:g}"
            )
    if plan.count > MOST_TASKS:
        raise BadInputError(
            "bad_config", f"{path}: the study has {plan.count} tasks", f"At most {MOST_TASKS}"
        )
    rig = load_rig(plan.rig)
    return Study(plan, load_model(plan.model), rig.operating_limits(), rig.controller.model_dump())


def run_study(
    study: Study,
    out: Path,
    *,
    cluster: str | None = None,
    workers: int | None = None,
    advance: Callable[[int], None] = lambda done: None,
    tell: Callable[[str], None] = lambda said: None,
) -> list[dict[str, Any]]:
    """Every task of the study, in order; those already in `out` are not run again.

    On `workers` processes of this machine, or on the Dask cluster whose scheduler listens at
    `cluster`. `advance` gets the number of tasks done, `tell` what is waited for. BadInputError
    where `out` holds another study.
    """
    out.mkdir(parents=True, exist_ok=True)
    done = _resume(study, out / TASKS)
    left = [task for task in range(study.plan.count) if task not in done]
    if left:
        # a cluster's workers need not see this disk
        where = out.resolve() if cluster is None else None
        with _executor(cluster, workers, tell) as pool, open_to_add(out / TASKS) as file:
            for found in _finished(pool, study, left, where):
                write_through(file, json.dumps(found) + "\n")
                done[found["task"]] = found
                advance(len(done))
    results = [done[task] for task in range(study.plan.count)]
    write_rows(out / TABLE, [_table_row(found) for found in results])
    return results


def _finished(
    pool: Executor, study: Study, tasks: list[int], out: Path | None
) -> Iterator[dict[str, Any]]:
    futures = [pool.submit(study.run, task, out) for task in tasks]
    try:
        for future in as_completed(futures):
            yield future.result()
    except HapticError:
        raise
    except Exception as error:  # Dask has errors of its own, and asyncio's
        if not _is_lost(error):
            raise
        said = f"a worker, or its scheduler, is lost ({type(error).__name__})"
        raise HapticError(
            "worker_lost", said, "Run the same command again: finished tasks are kept"
        ) from error
    finally:
        for future in futures:
            future.cancel()


def _is_lost(error: Exception) -> bool:
    """Whether an error is of who runs the tasks, and not of a task."""
    of_dask = type(error).__module__.partition(".")[0] == "distributed"
    return of_dask or isinstance(error, BrokenProcessPool | CancelledError)


def _resume(study: Study, path: Path) -> dict[int, dict[str, Any]]:
    """Finished tasks by number; a last line that was being written when the study stopped is cut
    off.
    """
    head = json.dumps({"study": study.plan.name, "hash": study.content_hash})
    lines = whole_lines(path).splitlines()
    if lines and lines[0] != head:
        said = f"{path}: holds another study, or the plan or model has changed"
        raise BadInputError("other_study", said, "Choose another --out")
    try:
        done = {found["task"]: found for found in map(json.loads, lines[1:])}
    except (ValueError, TypeError, KeyError) as error:
        raise BadInputError(
            "bad_study", f"{path}: is damaged ({error})", "Remove it to begin again"
        ) from error
    if not lines:
        write_text(path, head + "\n")
    return done


@contextmanager
def _executor(
    cluster: str | None, workers: int | None, tell: Callable[[str], None]
) -> Iterator[Executor]:
    """Processes of this machine, or the workers of a Dask cluster behind the same interface."""
    if cluster is None:
        with start_workers("study", workers or min(os.cpu_count() or 1, 8)) as pool:
            yield pool
        return
    distributed = optional("distributed", "cluster", "--cluster")
    try:
        client = distributed.Client(cluster, timeout=ANSWER_S)
    except (OSError, TimeoutError, ValueError) as error:
        said = f"no Dask scheduler answers at {cluster} ({error})"
        raise HapticError("no_cluster", said, "For example tcp://127.0.0.1:8786") from error
    with client, client.get_executor(pure=False) as pool:
        if not client.scheduler_info()["workers"]:
            tell(f"waiting for a worker at {cluster}: dask worker {cluster}")
            try:
                client.wait_for_workers(1, timeout=ANSWER_S)
            except TimeoutError as error:
                said = f"no worker has joined the scheduler at {cluster} in {ANSWER_S:g} s"
                raise HapticError(
                    "no_workers", said, f"Start one: dask worker {cluster}"
                ) from error
        yield pool


def _table_row(found: dict[str, Any]) -> dict[str, str | float]:
    numbers = found["values"] | {name: found[name] for name in NUMBERS}
    return {"task": found["task"], "finger": found["finger"]} | {
        name: f"{x:.9g}" for name, x in numbers.items()
    }


def statistics(study: Study, results: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """For every combination of levels: percentiles of each number over the fingers for which it
    exists.
    """
    combinations = study.plan.combinations
    found = []
    for i, levels in enumerate(combinations):
        own = results[i :: len(combinations)]
        spreads: dict[str, Any] = {}
        for name in NUMBERS:
            values = np.array([r[name] for r in own], dtype=float)
            known = values[np.isfinite(values)]
            percentiles = (
                np.percentile(known, PERCENTILES).tolist()
                if known.size
                else [None] * len(PERCENTILES)
            )
            spreads[name] = {f"p{p}": v for p, v in zip(PERCENTILES, percentiles, strict=True)}
            spreads[name]["count"] = int(known.size)
        found.append({"levels": levels, **spreads})
    return found
