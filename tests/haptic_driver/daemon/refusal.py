"""A call that the daemon must refuse."""

from __future__ import annotations

import pytest

from haptic_driver.daemon.messages import RefusedError


def refusal(call, *arguments):
    """Its error."""
    with pytest.raises(RefusedError) as refused:
        call(*arguments)
    return refused.value
