"""Every import rule holds, and each has an import that must break it."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

pytestmark = pytest.mark.process

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("haptic_driver", "model", "hw")

FORBIDDEN = [  # rule, file, import that must break it
    ("the-base-stands-alone", "haptic_driver/base/errors.py", "import hw.errors"),
    ("model-knows-no-devices", "model/solver.py", "import hw.amplifier.analog"),
    ("model-knows-no-devices", "model/solver.py", "import haptic_driver.errors"),
    ("the-model-reads-forward", "model/solver.py", "import model.touch_model"),
    ("the-model-reads-forward", "model/contact/gap_table.py", "import model.electric.layers"),
    ("hw-knows-no-physics", "hw/amplifier/analog.py", "import model.solver"),
    ("hw-knows-no-physics", "hw/finger/plant.py", "import haptic_driver.signals"),
    ("render-is-pure", "haptic_driver/render/tick.py", "import time"),
    (
        "render-is-pure",
        "haptic_driver/render/safety.py",
        "import hw.generator.agilent_33220a.driver",
    ),
    (
        "stages-meet-through-signals",
        "haptic_driver/render/safety.py",
        "import haptic_driver.render.controller",
    ),
    (
        "only-controller-reads-surface",
        "haptic_driver/render/texture.py",
        "import haptic_driver.render.surface",
    ),
    ("the-driver-reads-forward", "haptic_driver/signals.py", "import haptic_driver.limits"),
    ("the-driver-reads-forward", "haptic_driver/rig/rig.py", "import haptic_driver.simulation.rig"),
    (
        "the-driver-reads-forward",
        "haptic_driver/simulation/rig.py",
        "import haptic_driver.recording.event",
    ),
    (
        "the-driver-reads-forward",
        "haptic_driver/cli/output.py",
        "import haptic_driver.lab.commands.columns",
    ),
    (
        "the-driver-reads-forward",
        "haptic_driver/public/rigs.py",
        "import haptic_driver.lab.findings",
    ),
    ("the-devices-read-forward", "hw/generator/driver.py", "import hw.safety.watchdog"),
    (
        "the-laboratory-reads-forward",
        "haptic_driver/lab/measuring/plan.py",
        "import haptic_driver.lab.pictures.model",
    ),
    (
        "the-laboratory-reads-forward",
        "haptic_driver/lab/strokes/file.py",
        "import haptic_driver.lab.measuring.plan",
    ),
    ("live-reads-forward", "haptic_driver/live/comparison.py", "import haptic_driver.live.refit"),
    ("the-driver-reads-forward", "haptic_driver/daemon/daemon.py", "import haptic_driver.client"),
    (
        "the-driver-reads-forward",
        "haptic_driver/daemon/stepped.py",
        "import haptic_driver.lab.papers.document",
    ),
    (
        "the-render-process-is-alone",
        "haptic_driver/daemon/render_process.py",
        "import hw.amplifier.analog",
    ),
    ("the-render-process-is-alone", "haptic_driver/processes/shared_memory.py", "import h5py"),
    (
        "devices-do-not-know-their-simulators",
        "hw/generator/keysight/driver.py",
        "import hw.generator.keysight.scpi",
    ),
    ("devices-do-not-know-their-simulators", "hw/force/net_ft.py", "import hw.force.net_ft_server"),
]

EXHAUSTIVE = ("haptic_driver", "haptic_driver.lab", "hw", "model")


def lint(folder: Path) -> subprocess.CompletedProcess[str]:
    script = Path(sys.executable).with_name("lint-imports")
    command = [str(script), "--config", "pyproject.toml", "--no-cache"]
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )


def copy(folder: Path) -> Path:
    for package in PACKAGES:
        shutil.copytree(
            ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__")
        )
    shutil.copy(ROOT / "pyproject.toml", folder)
    return folder


def test_the_sources_keep_every_rule(tmp_path):
    result = lint(copy(tmp_path))
    assert result.returncode == 0, result.stdout
    assert " 0 broken" in result.stdout


@pytest.fixture(scope="module")
def broken(tmp_path_factory):
    """What is said of the sources with all these imports in them, each reported with its line, on
    one line.
    """
    folder = copy(tmp_path_factory.mktemp("broken"))
    for _, file, statement in FORBIDDEN:
        with (folder / file).open("a") as source:
            source.write(f"\n{statement}\n")
    result = lint(folder)
    assert result.returncode != 0
    return " ".join(result.stdout.split())


@pytest.mark.parametrize(("rule", "file", "statement"), FORBIDDEN)
def test_a_forbidden_import_breaks_its_rule(broken, rule, file, statement):
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"][
        "contracts"
    ]
    names = {c["id"]: c["name"] for c in contracts}
    assert f"{names[rule]} BROKEN" in broken
    told = broken.partition("Broken contracts")[2].partition(f"{names[rule]} ---")[2]
    told = re.split("|".join(re.escape(f"{name} ---") for name in names.values()), told)[0]
    importer, imported = file.removesuffix(".py").replace("/", "."), statement.split()[1]
    assert re.search(rf"- {re.escape(importer)} -> {re.escape(imported)} \(l", told), told


@pytest.fixture(scope="module")
def unlisted(tmp_path_factory):
    """What is said of the sources with a room more in each container of rooms."""
    folder = copy(tmp_path_factory.mktemp("unlisted"))
    for container in EXHAUSTIVE:
        (folder / container.replace(".", "/") / "unlisted.py").write_text('"""A room."""\n')
    return " ".join(lint(folder).stdout.split())


@pytest.mark.parametrize("container", EXHAUSTIVE)
def test_a_room_that_is_not_listed_breaks_its_rule(unlisted, container):
    assert f"{container}.unlisted" in unlisted


def test_every_rule_has_an_import_that_breaks_it():
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"][
        "contracts"
    ]
    assert {c["id"] for c in contracts} == {rule for rule, _, _ in FORBIDDEN}


def test_the_render_stages_load_neither_physics_nor_devices():
    program = (
        "import sys, haptic_driver.render.tick\nprint(sorted(m for m in sys.modules if"
        " m.split('.')[0] in ('model', 'hw', 'h5py', 'matplotlib')))"
    )
    result = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=True
    )
    assert result.stdout.strip() == "[]"
