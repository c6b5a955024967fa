"""One more effect is one file and one entry in one list: what follows knows it at once."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from model import effects
from model.effects import CATALOGUE
from tests.haptic_driver.commands import rows_of

pytestmark = pytest.mark.process

ROOT = Path(__file__).parents[3]
NEW = Path(__file__).with_name("stribeck_friction.py")
NAME, RISE, SCALE_M_S = "stribeck_friction", 1.5, 0.01
IMPORT, ENTRY = f"from model.effects.{NAME} import StribeckFriction\n", "    StribeckFriction,\n"
PLAN = """
name = "slides"
frequency_hz = [250]
voltage_v = [100]
normal_force_n = [0.3, 0.8]
speed_m_s = [0.005, 0.01, 0.02, 0.1]
repeats = 1
sessions = 1
voltage_off_every = 2
settle_s = 0.2
average_s = 0.25
pause_s = 0.0
"""
COMMANDS = """
predict --table conditions.csv --out with.csv --model with.toml
predict --table conditions.csv --out without.csv --model reference
surface build --model with.toml --out with.h5
measure --rig simulated --plan plan.toml --hide hide.toml --out data.csv
diagnose data.csv --model reference --out found
"""
# The package `model.effects` is taken from the folder, every other from where it is.
EXTENDED = "import sys, model; model.__path__.insert(0, sys.argv.pop(1))\n"
HAPTIC = """
import shlex
from haptic_driver.cli.main import main
for line in filter(str.strip, sys.stdin):
    if main(shlex.split(line)) != 0:
        sys.exit(line)
import reference
for text in (*reference.configuration().values(), reference.interventions()):
    print(text)
"""
ALL_PAIRS = "loses_more or TestOrder"  # of what is in the list already
TESTS = "import pytest; sys.exit(pytest.main(sys.argv[1:]))"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Effects as they are, with the new file among them and two more lines in the list's file."""
    folder = tmp_path_factory.mktemp("extended")
    inside = shutil.copytree(Path(effects.__file__).parent, folder / "effects")
    shutil.copy(NEW, inside)
    listed = (inside / "__init__.py").read_text(encoding="utf-8")
    last = f"    {[e for e in CATALOGUE if e.stage == 'friction'][-1].__name__},\n"
    assert listed.count(last) == 1
    listed = listed.replace("\nCATALOGUE", f"\n{IMPORT}\nCATALOGUE").replace(last, last + ENTRY)
    (inside / "__init__.py").write_text(listed, encoding="utf-8")
    return folder


def python(folder: Path, code: str, *words: str, given: str = "") -> str:
    """What a new process says that runs `code` with the effects of the folder."""
    path = os.pathsep.join([str(ROOT), str(ROOT / "docs")])
    done = subprocess.run(
        [sys.executable, "-c", EXTENDED + code, str(folder), *words],
        input=given,
        env=os.environ | {"PYTHONPATH": path},
        cwd=folder,
        capture_output=True,
        text=True,
        start_new_session=True,  # a run of pytest changes the precedence of its session
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def done(folder):
    """The folder after the commands, with what was said in it."""
    values = f"rise = {RISE}\nspeed_scale_m_s = {SCALE_M_S}\n"
    model = (ROOT / "configs" / "models" / "reference.toml").read_text(encoding="utf-8")
    (folder / "with.toml").write_text(f"{model}\n[effects.{NAME}]\n{values}", encoding="utf-8")
    (folder / "hide.toml").write_text(f"[{NAME}]\n{values}", encoding="utf-8")
    (folder / "plan.toml").write_text(PLAN, encoding="utf-8")
    rows = "frequency_hz,voltage_v,normal_force_n,speed_m_s\n250,75,0.5,0.01\n250,75,0.5,0.05\n"
    (folder / "conditions.csv").write_text(rows, encoding="utf-8")
    (folder / "said").write_text(python(folder, HAPTIC, given=COMMANDS), encoding="utf-8")
    return folder


def cof_in(path: Path) -> np.ndarray:
    return np.array([float(row["cof"]) for row in rows_of(path)])


def test_it_changes_what_is_predicted(done):
    expected = 1.0 + 1.5 * np.exp([-1.0, -5.0])  # rise 1.5, at one and five times the scale
    factor = cof_in(done / "with.csv") / cof_in(done / "without.csv")
    np.testing.assert_allclose(factor, expected, rtol=1e-7)  # nine digits are written


def test_it_is_in_a_surface(done):
    """At 20 mm/s, of which surfaces are, and without voltage."""
    with h5py.File(done / "with.h5") as file:
        undriven = file["cof"][:, 0]
    np.testing.assert_allclose(undriven, 0.512 * (1.0 + 1.5 * np.exp(-2.0)), rtol=1e-6)


def test_it_is_named_where_it_is_hidden(done):
    said: dict[str, Any] = json.loads((done / "found" / "report.json").read_text(encoding="utf-8"))
    assert len(said["alternatives"]) == len(CATALOGUE) + 3  # the new one, none and unknown
    assert [effect["name"] for effect in said["effects"]] == [NAME]
    for name, true in (("rise", RISE), ("speed_scale_m_s", SCALE_M_S)):
        found = said["effects"][0]["parameters"][name]
        assert abs(found["value"] - true) < 4.0 * found["std"]
    assert said["model"].endswith("model.toml")
    assert f"[effects.{NAME}]" in (done / "found" / "model.toml").read_text(encoding="utf-8")


def test_it_is_on_the_pages_of_the_docs(done):
    pages = (done / "said").read_text(encoding="utf-8").splitlines()
    physics = "a film of sweat is sheared where the skin slides fast, and pressed out where not"
    prior = "0.3, × 3"
    assert f"| `{NAME}` | `rise` | 0.0001 to 100 | {prior} | 1 | 0 | {physics} |" in pages
    assert any(re.match(rf"\| `wipe` \| .*`{NAME}`", line) for line in pages)


def test_what_holds_of_every_effect_is_tested_of_it(folder):
    tests = [str(Path(__file__).with_name(f"test_{n}.py")) for n in ("catalogue", "effect_files")]
    options = ("-p", "no:cacheprovider", "-c", str(ROOT / "pyproject.toml"))
    said = python(
        folder, TESTS, *tests, *options, "-k", f"TestTheList or {NAME} and not ({ALL_PAIRS})"
    )
    (passed,) = re.findall(r"(\d+) passed", said)
    assert int(passed) > 20
