"""Diagnoses whose pictures nobody looks at: drawing them takes a third of the time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from model.reporting import report


@contextmanager
def without_pictures() -> Iterator[None]:
    """Reports are written without."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(report, "pictures", lambda diagnosis: {})
        yield
