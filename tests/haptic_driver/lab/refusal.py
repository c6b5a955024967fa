"""What is refused: by its code, and by words of its message and hint."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from haptic_driver.errors import BadInputError, HapticError


@contextmanager
def refused(
    code: str, *words: str, hint: str = "", kind: type[HapticError] = BadInputError
) -> Iterator[None]:
    """The block ends with that error and something to do; each of `words` is in its message."""
    with pytest.raises(kind) as caught:
        yield
    error = caught.value
    assert error.code == code, error.message
    assert [word for word in words if word not in error.message] == [], error.message
    assert error.hint
    assert hint in error.hint


@pytest.fixture
def refuses(haptic: Callable[..., Any]) -> Callable[..., dict[str, str]]:
    """Run a command line that ends with that code and status; its error, by `--json`."""

    def run(code: str, *arguments: object, status: int = 2) -> dict[str, str]:
        done = haptic(*arguments, "--json")
        assert (done.status, done.said["error"]["code"]) == (status, code), done.err
        error: dict[str, str] = done.said["error"]
        return error

    return run
