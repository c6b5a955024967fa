"""What a generator's driver reads, where a test asks only for the output."""

from __future__ import annotations

from hw.errors import DeviceError
from hw.generator.driver import GeneratorDriver


def read_output(driver: GeneratorDriver) -> bool | None:
    """Whether the output is on; None when that cannot be known."""
    try:
        with driver._forgetting_on_failure():
            return driver._ask_output()
    except DeviceError:
        return None
