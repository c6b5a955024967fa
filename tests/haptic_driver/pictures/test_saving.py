"""Pictures are what their names say, and are closed whatever happens."""

import matplotlib.pyplot as plt
import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.pictures.saving import saved


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
        pytest.raises(BadInputError, match="no name of a picture"),
        saved(plt.figure(), tmp_path / "x.gif"),
    ):
        pytest.fail("drawn")
    assert plt.get_fignums() == []


def test_a_picture_whose_drawing_fails_is_closed(tmp_path):
    with pytest.raises(ZeroDivisionError), saved(plt.figure(), tmp_path / "x.png"):
        raise ZeroDivisionError
    assert plt.get_fignums() == []
    assert list(tmp_path.iterdir()) == []
