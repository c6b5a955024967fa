"""What is written as TOML is read back by the standard library's reader."""

import datetime
import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.support.toml import toml_lines, toml_value

SCALARS = (
    st.text()
    | st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False)
    | st.dates()
)
NAMES = st.text("abcdefghijklmnopqrstuvwxyz_0123456789", min_size=1)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(NAMES, inner, max_size=3),
    max_leaves=4,
)


@settings(max_examples=50)
@given(st.dictionaries(NAMES, VALUES, max_size=3))
def test_every_value_is_read_back(content):
    assert tomllib.loads(toml_lines(content)) == content


@pytest.mark.parametrize(
    "name", ["𠮷田", 'A. "Smith"', "back\\slash", "two\nlines", "del\x7f", "\x00\x1f", "é"]
)
def test_a_name_beyond_the_basic_plane_makes_no_file_unreadable(name):
    assert tomllib.loads(f"by = {toml_value(name)}") == {"by": name}


def test_bytes_of_no_encoding_are_replaced():
    assert toml_lines({"by": "a\udcff", "left": None}) == 'by = "a?"\n'


def test_a_day_is_a_day():
    assert toml_value(datetime.date(2026, 11, 28)) == "2026-11-28"
