"""Contact areas against 200 drawn films over scale, blur, noise and light, of other forms than the
shipped camera's, on which nothing was tuned.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.claim import Claim
from tests.haptic_driver.lab.contact.test_areas import AREA_WITHIN, RIDGES_WITHIN, of_film

FILMS = 200


def run() -> Iterator[Claim]:
    errors = np.abs([of_film(number) for number in range(FILMS)])
    area, ridges = errors[:, 0], errors[np.isfinite(errors[:, 1]), 1]
    for what, found, within in (
        (f"apparent contact area, {FILMS} drawn films", area, AREA_WITHIN),
        (f"area of the ridges, measured in {ridges.size} of them", ridges, RIDGES_WITHIN),
    ):
        said = f"off by {np.median(found):.2%} at the median, {found.max():.2%} at worst"
        yield Claim(what, said, f"within {within:.0%}", bool(found.max() <= within))
