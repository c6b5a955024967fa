"""The effect that `CONTRIBUTING.md` adds is one that the model can have."""

import importlib
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from haptic_driver.lookup.models import load_model
from model.conditions import Conditions
from model.effects import BY_NAME, CATALOGUE
from model.touch_model import TouchModel
from tests.fingers import hiding

PAGE = Path(__file__).resolve().parents[2] / "CONTRIBUTING.md"


@pytest.fixture(scope="module")
def dry_film(tmp_path_factory):
    (block,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    folder = tmp_path_factory.mktemp("effect")
    (folder / "dry_film.py").write_text(block)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        yield importlib.import_module("dry_film").DryFilm
    del sys.modules["dry_film"]


def test_half_of_the_area_carries_between_half_and_all_of_the_current(dry_film, monkeypatch):
    """Half the area under the same load is pressed twice as hard: its gap is narrower, not open."""
    monkeypatch.setitem(BY_NAME, dry_film.name, dry_film)
    bare = load_model("reference")
    covered = hiding(bare, dry_film={"covered": 0.5})
    asked = Conditions(np.array([1000.0]), np.array([1.0]), np.array([0.5]))
    bare_a, covered_a = (
        float(TouchModel(model).predict(asked).current_rms_a[0]) for model in (bare, covered)
    )
    assert 0.5 < covered_a / bare_a < 1.0


def test_its_name_is_not_taken(dry_film):
    assert dry_film.name not in {kind.name for kind in CATALOGUE}
