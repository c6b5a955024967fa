"""A call that the daemon must refuse."""

from __future__ import annotations

import pytest

from haptic_driver.errors import HapticError


def refusal(call, *arguments):
    with pytest.raises(HapticError) as refused:
        call(*arguments)
    return refused.value
