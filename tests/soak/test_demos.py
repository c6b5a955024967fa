"""The demos that take minutes end, and show what they are there for."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.soak
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("demo", "shown"),
    [
        ("demo_live", "Skin hydration is missing from the model"),
        ("demo_experiment", "the diagnosis says effect_found: floating body"),
    ],
)
def test_a_long_demo_names_what_is_hidden(demo, shown, tmp_path):
    command = [sys.executable, ROOT / "demos" / f"{demo}.py", "--out", tmp_path]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert ended.returncode == 0, ended.stderr[-2000:]
    assert shown in " ".join(ended.stdout.split())
