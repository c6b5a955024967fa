"""Every file and snippet in docs/textures.md works as shown."""

import re
from pathlib import Path

import numpy as np
import pytest

from haptic_driver.config import texture_dirs
from haptic_driver.textures.library import load

PAGE = Path(__file__).parents[3] / "docs" / "textures.md"
NAMED = re.compile(
    r"`([a-z]+\.(?:toml|csv|hjif))`[^`]*:\n\n```(?:toml|csv|json)\n(.*?)```", re.DOTALL
)


@pytest.fixture
def page(tmp_path, monkeypatch):
    """The page's text, in a folder with all the files that it shows and that its first snippet
    writes.
    """
    monkeypatch.chdir(tmp_path)
    text = PAGE.read_text(encoding="utf-8")
    for name, content in NAMED.findall(text):
        (tmp_path / name).write_text(content)
    exec(re.findall(r"```python\n(.*?)```", text, re.DOTALL)[0], {})
    return text


@pytest.mark.parametrize(
    ("name", "x_m", "y_m", "cof"),
    [
        ("flat", 0.0, 0.0, 0.60),
        ("stripes", 0.0003, 0.0003, 0.75),  # 0.42 mm along the diagonal, of 0.9 mm that are high
        ("dunes", 0.00025, 0.00025, 0.65),
        ("patch", 0.00525, 0.001, 0.62),  # the centre of column 10
        ("edge", 0.3, 0.0301, 0.65),  # halfway up
        ("bump", 0.030, 0.0, 0.75),
        ("button", 0.0, 0.0, 0.55),
        ("keys", 0.060, 0.045, 0.80),
        ("keys", 0.005, 0.005, 0.55),
    ],
)
def test_textures(page, name, x_m, y_m, cof):
    assert load(f"./{name}.toml", texture_dirs()).target.cof_at(x_m, y_m) == pytest.approx(cof)


def test_grains_spectra_and_scripts(page):
    assert load("./grains.toml", texture_dirs()).target.bounds() == pytest.approx(
        (0.53, 0.77), abs=0.02
    )
    low, high = load("./weave.toml", texture_dirs()).target.bounds()
    assert 0.5 < low < 0.65
    assert 0.71 < high < 0.9
    tweed = load("./tweed.toml", texture_dirs()).target
    slow, fast = (
        tweed.under(speed_m_s, 0.5).cof_at(np.linspace(0.0, 0.064, 5000), 0.0)
        for speed_m_s in (0.02, 0.12)
    )
    assert (slow.std(), fast.std()) == pytest.approx((0.012, 0.020), rel=0.05)
    assert load("./edge.csv", texture_dirs()).kind == "profile"
    for name in ("./trial.csv", "./trial.toml"):
        labels = [m.label for m in load(name, texture_dirs()).target.markers(-1.0, 10.0)]
        assert labels == ["baseline", "rise", "plateau", "cloth", "end"]
    assert load("./short.toml", texture_dirs()).target.end_s == 5.0


def test_every_toml_block_is_tried(page):
    assert len(NAMED.findall(page)) == len(re.findall(r"```(?:toml|csv|json)\n", page)) == 16


def test_python(page, tmp_path):
    exec(re.findall(r"```python\n(.*?)```", page, re.DOTALL)[1], {})
    assert (tmp_path / "linen.png").is_file()
