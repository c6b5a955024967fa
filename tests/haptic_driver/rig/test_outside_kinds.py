"""Kinds of parts that fail, exit or hang at import, from packages outside: they break no rig but
their own.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from haptic_driver.rig.roles import ROLES, KindRole
from hw.generator import contract as generators
from tests.haptic_driver.config_texts import SIMULATED
from tests.waiting import HANG_S

HAPTIC = Path(sys.executable).with_name("haptic")
GROUPS = [role.group for role in ROLES.values() if isinstance(role, KindRole)]
AT_IMPORT = {
    "fails": "raise RuntimeError('no licence')",
    "exits": "raise SystemExit(3)",
    "ends": "import os; os._exit(7)",
    "hangs": "import time; time.sleep(1e6)",
}
pytestmark = [pytest.mark.timeout(300), pytest.mark.process]


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The environment of a computer on which packages are installed whose kinds leave a file when
    they are imported.
    """
    folder = tmp_path_factory.mktemp("installed")
    for name, code in AT_IMPORT.items():
        left = f"open({str(folder / (name + '.imported'))!r}, 'w').close()\n"
        groups = [*GROUPS, generators.GROUP]
        points = "".join(f"[{group}]\n{name} = kind_that_{name}:KIND\n" for group in groups)
        install(folder, f"kind_that_{name}", left + code, points)
    return environment(folder)


def install(folder, module, code, points):
    (folder / f"{module}.py").write_text(code)
    about = folder / f"{module}-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(points)


def environment(folder):
    path = os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH")]))
    return {**os.environ, "PYTHONPATH": path, "FOLDER": str(folder)}


def run(installed, *arguments):
    command = [str(HAPTIC), *map(str, arguments)]
    return subprocess.run(
        command, env=installed, capture_output=True, text=True, timeout=HANG_S, check=False
    )


def imported(installed):
    return sorted(path.name for path in Path(installed["FOLDER"]).glob("*.imported"))


def test_a_rig_that_does_not_name_them_imports_none_of_them(installed, surface_path):
    surface = ["--surface", surface_path]
    for arguments in (
        ["doctor", "--rig", "simulated"],
        ["solve", "--friction", "0.6", *surface],
        ["texture", "check", "grating", *surface],
    ):
        done = run(installed, *arguments)
        assert done.returncode == 0, (arguments, done.stderr)
    assert imported(installed) == []


@pytest.mark.parametrize(
    ("name", "said"), [("fails", "RuntimeError: no licence"), ("exits", "SystemExit: 3")]
)
def test_a_rig_that_names_one_is_refused_and_says_which(installed, tmp_path, name, said):
    rig = tmp_path / "lab.toml"
    rig.write_text(f'{SIMULATED}\n[finger_tracker]\nkind = "{name}"\n')
    done = run(installed, "doctor", "--rig", rig)
    assert done.returncode == 2
    assert f"'{name}' (kind_that_{name}:KIND) cannot be loaded: {said}" in " ".join(
        done.stderr.split()
    )


def test_a_kind_that_is_not_there_is_told_with_the_nearest_of_all_names(installed, tmp_path):
    rig = tmp_path / "lab.toml"
    rig.write_text(SIMULATED + '\n[force_sensor]\nkind = "hang"\n')
    before = imported(installed)
    done = run(installed, "doctor", "--rig", rig)
    assert done.returncode == 2
    assert "force_sensor.kind is 'hang'" in done.stderr
    assert "hangs" in done.stderr
    assert imported(installed) == before
