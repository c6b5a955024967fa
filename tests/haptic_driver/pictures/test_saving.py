"""Pictures are what their names say, and are closed whatever happens."""

import matplotlib.pyplot as plt
import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.pictures.saving import saved


@pytest.fixture(autouse=True)
def nothing_left_by_others():
    plt.close("all")


@pytest.mark.parametrize("ending", [".png", ".pdf", ".svg", ".PNG"])
def test_a_picture_is_what_its_name_says(tmp_path, ending):
    path = tmp_path / f"x{ending}"
    with saved(plt.figure(), path):
        pass
    begins = {".png": b"\x89PNG", ".pdf": b"%PDF", ".svg": b"<?xml"}[ending.lower()]
    assert path.read_bytes().startswith(begins)
    assert plt.get_fignums() == []


def test_a_picture_that_cannot_be_named_is_refused_before_it_is_drawn(tmp_path):
    with (
        pytest.raises(BadInputError, match=r"its ending is none of \.png, \.pdf, \.svg"),
        saved(plt.figure(), tmp_path / "x.gif"),
    ):
        pytest.fail("drawn")
    assert plt.get_fignums() == []


def test_a_picture_whose_drawing_fails_is_closed(tmp_path):
    with pytest.raises(ZeroDivisionError), saved(plt.figure(), tmp_path / "x.png"):
        raise ZeroDivisionError
    assert plt.get_fignums() == []
    assert list(tmp_path.iterdir()) == []


NAMES = ("co$t $x_1$", r"$\frac{$", "caf\udce9", "two\x1b[2J", "$")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("ending", [".png", ".svg"])
def test_a_name_is_drawn_as_it_stands_and_is_no_formula(tmp_path, name, ending):
    figure, axes = plt.subplots()
    with saved(figure, tmp_path / f"x{ending}"):
        axes.set(title=name, xlabel=name, xscale="log", xlim=(1.0, 1e3))
        axes.plot([1.0, 10.0], [0.0, 1.0], label=name)
        axes.text(1.0, 0.5, name)
        axes.legend()
        figure.suptitle(name)
    texts = {name, name.replace("\udce9", "\\udce9").replace("\x1b", "\\x1b")}
    assert axes.get_title() in texts
    assert axes.get_title().isprintable()
    assert not axes.title.get_parse_math()
    assert axes.get_xmajorticklabels()[2].get_parse_math()  # 10 to a power is a formula
