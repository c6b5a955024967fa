"""`make mutate`: small faults, one at a time, in what safety and truth rest on; which of them no
test notices.

Cosmic Ray makes the faults, in two copies of the repository beside one another. By default those in
lines changed since `--base`; with `--all` a sample of every module, drawn by `--seed`. Survivors
are printed with their lines: `docs/reliability.md` counts them.
"""

from __future__ import annotations

import argparse
import random
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import TestOutcome, WorkerOutcome, WorkItem, WorkResult

ROOT = Path(__file__).resolve().parents[2]
DECISION = ["tests/model/diagnosis/test_decide.py"]
RIG = [f"tests/haptic_driver/rig/test_{name}.py" for name in ("rig", "actuator", "rig_faults")]
COPIES = 2
TIMEOUT_S = 180.0  # a fault that hangs is noticed, too
SAMPLE = 16  # faults of each module, with --all
# Annotations are never worked out; a decorator or a keyword that is missing is noticed by whatever
# is called first.
SENSELESS = ("ReplaceBinaryOperator_BitOr", "RemoveDecorator")
TESTS = {
    "haptic_driver/render/safety.py": ["tests/haptic_driver/render/test_safety.py"],
    "haptic_driver/limits.py": [
        "tests/haptic_driver/test_limits.py",
        "tests/haptic_driver/render/test_safety.py",
    ],
    "haptic_driver/render/controller.py": [
        f"tests/haptic_driver/render/test_{name}.py" for name in ("controller", "envelope")
    ],
    "haptic_driver/render/feedback.py": ["tests/haptic_driver/render/test_feedback.py"],
    "haptic_driver/rig/states.py": RIG,
    "haptic_driver/rig/rig.py": RIG,
    "haptic_driver/rig/evidence.py": RIG,
    "haptic_driver/rig/monitor.py": RIG,
    "hw/generator/gate.py": ["tests/hw/generator"],
    "hw/generator/driver.py": ["tests/hw/generator"],
    "hw/safety/watchdog.py": ["tests/hw/safety/test_watchdog.py"],
    "haptic_driver/rig/switch.py": RIG,
    "haptic_driver/daemon/state_machine.py": ["tests/haptic_driver/daemon/test_state_machine.py"],
    "model/solver.py": ["tests/model/test_solver.py"],
    "model/electric/current.py": ["tests/model/electric"],
    "model/friction.py": ["tests/model/test_friction.py"],
    "model/diagnosis/posterior.py": DECISION,
    "model/diagnosis/decide.py": DECISION,
    "model/diagnosis/hidden.py": ["tests/model/diagnosis/test_unseen.py"],
    "model/diagnosis/hypotheses.py": [
        "tests/model/diagnosis/test_pairs.py",
        "tests/model/diagnosis/test_force_sensor.py",
    ],
}


def main() -> int:
    """0 where every fault that is tried is noticed."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument(
        "--all", action="store_true", help="a sample of every module, whatever has changed"
    )
    parser.add_argument("--base", default="HEAD~1", help="a commit: lines changed since are tried")
    parser.add_argument(
        "--sample", type=int, default=SAMPLE, help="faults of each module, with --all"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--modules", nargs="*", default=list(TESTS), choices=list(TESTS), metavar="MODULE"
    )
    asked = parser.parse_args()
    survived = tried = 0
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(COPIES) as pool:
        copies: SimpleQueue[Path] = SimpleQueue()
        for number in range(COPIES):
            copies.put(_copy(Path(folder, str(number))))

        def work(module: str) -> tuple[str, list[WorkResult]]:
            copy = copies.get()
            try:
                return module, _try(copy, module, asked)
            finally:
                copies.put(copy)

        for module, results in pool.map(work, asked.modules):
            alive = [result for result in results if result.test_outcome is TestOutcome.SURVIVED]
            print(f"{module}: {len(results) - len(alive)} of {len(results)} noticed", flush=True)
            for result in alive:
                print("\n".join((result.diff or "").splitlines()[2:]) + "\n", flush=True)
            tried, survived = tried + len(results), survived + len(alive)
    print(f"{tried - survived} of {tried} faults noticed")
    return 1 if survived else 0


def _copy(folder: Path) -> Path:
    """The repository with what is not committed yet: the faults go into files."""
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(folder)], check=True)
    changes = subprocess.run(
        ["git", "diff", "HEAD", "--binary"], cwd=ROOT, check=True, capture_output=True
    ).stdout
    if changes:
        subprocess.run(["git", "apply", "-"], cwd=folder, check=True, input=changes)
    return folder


def _try(copy: Path, module: str, asked: argparse.Namespace) -> list[WorkResult]:
    """What a module's tests made of every fault that is asked for."""
    tests = " ".join(TESTS[module])
    config, session = copy / "mutation.toml", copy / "mutation.sqlite"
    config.write_text(
        f'[cosmic-ray]\nmodule-path = "{module}"\ntimeout = {TIMEOUT_S}\nexcluded-modules = []\n'
        f'test-command = "{sys.executable} -m pytest -q -x -n 0 -p no:cacheprovider {tests}"\n'
        '[cosmic-ray.distributor]\nname = "local"\n'
        f'[cosmic-ray.filters.git-filter]\nbranch = "{asked.base}"\n'
    )
    session.unlink(missing_ok=True)
    _run(copy, "cosmic-ray", "init", config.name, session.name)
    if not asked.all:
        _run(copy, "cr-filter-git", "--config", config.name, session.name)
    with use_db(session, WorkDB.Mode.open) as found:
        pending = [item for item in found.pending_work_items if not _is_senseless(item)]
        chosen = (
            random.Random(asked.seed).sample(pending, min(asked.sample, len(pending)))
            if asked.all
            else pending
        )
        kept = {item.job_id for item in chosen}
        for item in list(found.pending_work_items):
            if item.job_id not in kept:
                found.set_result(item.job_id, WorkResult(worker_outcome=WorkerOutcome.SKIPPED))
    if kept:
        _run(copy, "cosmic-ray", "exec", config.name, session.name)
    with use_db(session, WorkDB.Mode.open) as found:
        return [result for item, result in found.completed_work_items if item.job_id in kept]


def _is_senseless(item: WorkItem) -> bool:
    return any(name in mutation.operator_name for mutation in item.mutations for name in SENSELESS)


def _run(copy: Path, *command: str) -> None:
    """One of Cosmic Ray's own commands, from where this Python lies."""
    program = str(Path(sys.executable).parent / command[0])
    subprocess.run([program, *command[1:]], cwd=copy, check=True, stdout=subprocess.DEVNULL)


if __name__ == "__main__":
    sys.exit(main())
