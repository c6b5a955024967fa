"""Every import rule holds, and each has an import that must break it."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("haptic_driver", "model", "hw")

FORBIDDEN = [  # rule, file, import that must break it
    ("model-knows-no-devices", "model/solver.py", "import hw.amplifier.analog"),
    ("model-knows-no-devices", "model/solver.py", "import haptic_driver.errors"),
    ("the-model-reads-forward", "model/solver.py", "import model.touch_model"),
    ("the-model-reads-forward", "model/contact/gap_table.py", "import model.electric.layers"),
    ("hw-knows-no-physics", "hw/amplifier/analog.py", "import model.solver"),
    ("hw-knows-no-physics", "hw/finger/plant.py", "import haptic_driver.signals"),
    ("render-is-pure", "haptic_driver/render/tick.py", "import time"),
    ("render-is-pure", "haptic_driver/render/texture.py", "from pathlib import Path"),
    ("render-is-pure", "haptic_driver/render/safety.py", "import hw.generator.agilent_33220a.driver"),
    ("render-is-pure", "haptic_driver/render/surface.py", "import model.friction"),
    ("render-is-pure", "haptic_driver/render/drive.py", "import haptic_driver.rig.rig"),
    ("stages-meet-through-signals", "haptic_driver/render/safety.py", "import haptic_driver.render.controller"),
    ("only-controller-reads-surface", "haptic_driver/render/texture.py", "import haptic_driver.render.surface"),
    ("the-driver-reads-forward", "haptic_driver/signals.py", "import haptic_driver.limits"),
    ("the-driver-reads-forward", "haptic_driver/textures/reach.py", "import haptic_driver.rig.config"),
    ("the-driver-reads-forward", "haptic_driver/processes/child.py", "import haptic_driver.textures.files"),
    ("the-driver-reads-forward", "haptic_driver/rig/rig.py", "import haptic_driver.simulation.rig"),
    ("the-driver-reads-forward", "haptic_driver/simulation/rig.py", "import haptic_driver.recording.event"),
    ("the-driver-reads-forward", "haptic_driver/recording/read.py", "import haptic_driver.daemon.messages"),
    ("the-driver-reads-forward", "haptic_driver/experiments/plan.py", "import haptic_driver.pictures.model"),
    ("the-driver-reads-forward", "haptic_driver/daemon/daemon.py", "import haptic_driver.client"),
    ("the-driver-reads-forward", "haptic_driver/client.py", "import haptic_driver.cli.output"),
    ("the-render-process-is-alone", "haptic_driver/daemon/render_process.py", "import hw.amplifier.analog"),
    ("the-render-process-is-alone", "haptic_driver/processes/shared_memory.py", "import h5py"),
    (
        "devices-do-not-know-their-simulators",
        "hw/generator/keysight/driver.py",
        "import hw.generator.keysight.scpi",
    ),
    ("devices-do-not-know-their-simulators", "hw/generator/siglent_sdg/driver.py", "import hw.generator.terminals"),
    ("devices-do-not-know-their-simulators", "hw/force/net_ft.py", "import hw.force.net_ft_server"),
]


def lint(folder: Path) -> subprocess.CompletedProcess[str]:
    script = Path(sys.executable).with_name("lint-imports")
    command = [str(script), "--config", "pyproject.toml", "--no-cache"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def test_the_sources_keep_every_rule(copy: Path) -> None:
    result = lint(copy)
    assert result.returncode == 0, result.stdout
    assert " 0 broken" in result.stdout


@pytest.mark.parametrize(("rule", "file", "statement"), FORBIDDEN)
def test_a_forbidden_import_breaks_its_rule(copy: Path, rule: str, file: str, statement: str) -> None:
    path = copy / file
    path.write_text(path.read_text() + f"\n{statement}\n")
    contracts = tomllib.loads((copy / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    name = next(c["name"] for c in contracts if c["id"] == rule)
    result = lint(copy)
    assert result.returncode != 0
    assert f"{name} BROKEN" in " ".join(result.stdout.split()), result.stdout


def test_every_rule_has_an_import_that_breaks_it() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    assert {c["id"] for c in contracts} == {rule for rule, _, _ in FORBIDDEN}


def test_the_render_stages_load_neither_physics_nor_devices() -> None:
    program = (
        "import sys, haptic_driver.render.tick\n"
        "print(sorted(m for m in sys.modules if m.split('.')[0] in ('model', 'hw', 'h5py', 'matplotlib')))"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=True)
    assert result.stdout.strip() == "[]"
