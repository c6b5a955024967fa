"""Calls of libraries that know no timeout, given up in time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

Made = TypeVar("Made")


def in_time(
    work: Callable[[], Made], timeout_s: float, too_late: Callable[[Made], object] | None = None
) -> Made:
    """What `work` makes in a thread of its own; TimeoutError when it takes longer, `too_late` gets
    it then.
    """
    doing: Future[Made] = Future()

    def run() -> None:
        try:
            doing.set_result(work())
        except BaseException as error:
            doing.set_exception(error)

    def ended(done: Future[Made]) -> None:
        if too_late is not None and done.exception() is None:
            too_late(done.result())

    threading.Thread(target=run, name="bounded", daemon=True).start()
    try:
        return doing.result(timeout_s)
    except TimeoutError:
        doing.add_done_callback(ended)
        raise
