"""A refitted model has to predict unseen windows clearly better than the present one does.

The windows that judge are those of the most recent strokes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from haptic_driver.live.refit import refit, weighted
from haptic_driver.live.window import Window
from model.description import ModelDescription
from model.support.errors import ModelError

LEAST_UNSEEN = 5  # windows
BETTER = 3.0  # nats, by which the unseen windows must be more probable


class Attempt(NamedTuple):
    """What came of an attempt, in words; `model` is None where it is not better."""

    said: str
    model: ModelDescription | None = None


def split(windows: Sequence[Window]) -> tuple[list[Window], list[Window]]:
    """Windows in order of time without those of the newest strokes, and those.

    As few strokes as give LEAST_UNSEEN windows.
    """
    unseen: list[Window] = []
    for each in reversed(windows):
        if len(unseen) >= LEAST_UNSEEN and each[-2:] != unseen[-1][-2:]:  # another stroke
            break
        unseen.append(each)
    return list(windows[: len(windows) - len(unseen)]), unseen[::-1]


def attempt(
    known: Sequence[Window],
    unseen: Sequence[Window],
    own: ModelDescription,
    present: ModelDescription,
) -> Attempt:
    """Refit `own`, the model as its file has it, and prove it against `present`, the one in use."""
    now_s = max(each.time_s for each in unseen)
    try:
        model, fitted = refit(known, own, now_s)
    except ModelError as error:
        return Attempt(f"{error.message}. {error.hint}" if error.hint else error.message)
    nats, shares = [], []
    for each in (present, model):
        off, weight = weighted(each, unseen, now_s)
        squares = weight * np.nan_to_num(off**2, nan=np.inf)
        nats.append(0.5 * float(np.sum(squares)))
        shares.append(f"{100.0 * np.sqrt(np.sum(squares) / np.sum(weight)):.1f} %")
    told = f"{shares[0]} off before, {shares[1]} now, over {len(unseen)} unseen rows"
    if not nats[1] + BETTER < nats[0]:
        return Attempt(f"a new model is not better than the present one: {told}")
    return Attempt(f"{told}; {fitted}", model)
