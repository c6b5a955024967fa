"""Levels by somebody else's optimiser: ask for the next one, report the outcome; in Python or over
HTTP.

A Python class has `suggest()`, which gives a level or None at the end, and `report(level,
positive)`; it is made with the keywords `experiment` and `condition`. Its module is installed, or
lies beside the experiment's file. A server at URL answers

    GET  URL/suggest?experiment=E&condition=C   {"level": 0.1}, or {"level": null} at the end
    POST URL/report                             {"experiment", "condition", "level", "positive"}

with a status of 200. After a crash everything is reported again, from the first trial.
"""

from __future__ import annotations

import importlib
import json
import math
import sys
from pathlib import Path
from typing import Any, Protocol
from urllib.error import URLError
from urllib.parse import urlencode
from urllib.request import Request, urlopen

from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.lab.psychophysics.description import Outside

TIMEOUT_S = 30.0


class Optimiser(Protocol):
    """What a class, or the client of a server, does."""

    def suggest(self) -> float | None:
        """The next level."""

    def report(self, level: float, positive: bool) -> None:
        """Its outcome."""


class OutsideMethod:
    """An optimiser of others for one condition, with at most so many trials."""

    def __init__(self, settings: Outside, about: dict[str, str], folder: Path) -> None:
        self._optimiser = _client(settings, about, folder)
        self._left = settings.trials
        self._next: float | None = None

    def suggest(self) -> float | None:
        """Asked once per outcome. HapticError for an answer that is no level."""
        if self._next is None and self._left > 0:
            level = self._optimiser.suggest()
            if level is not None and not (isinstance(level, int | float) and math.isfinite(level)):
                raise HapticError(
                    "bad_suggestion",
                    f"the optimiser suggests {level!r}",
                    "It must give a number or null",
                )
            self._next = None if level is None else float(level)
        return self._next

    def report(self, level: float, positive: bool) -> None:
        self._optimiser.report(level, positive)
        self._left -= 1
        self._next = None


class _Server:
    """An optimiser over HTTP."""

    def __init__(self, url: str, about: dict[str, str]) -> None:
        self._url = url.rstrip("/")
        self._about = about

    def suggest(self) -> float | None:
        said = self._asked(Request(f"{self._url}/suggest?{urlencode(self._about)}"))
        if not isinstance(said, dict) or "level" not in said:
            raise HapticError(
                "bad_suggestion",
                f"{self._url}/suggest answers {said!r}",
                'It must give {"level": 0.1}',
            )
        level: float | None = said["level"]
        return level

    def report(self, level: float, positive: bool) -> None:
        content = json.dumps(self._about | {"level": level, "positive": positive}).encode()
        self._asked(Request(f"{self._url}/report", content, {"Content-Type": "application/json"}))

    def _asked(self, request: Request) -> Any:
        try:
            with urlopen(request, timeout=TIMEOUT_S) as answer:
                content = answer.read()
            return json.loads(content) if content else None
        except (URLError, OSError, ValueError) as error:
            said = f"{request.full_url}: {error}"
            raise HapticError(
                "no_optimiser", said, "Start its server, or correct url in [method]"
            ) from error


def _client(settings: Outside, about: dict[str, str], folder: Path) -> Optimiser:
    if settings.url is not None:
        return _Server(settings.url, about)
    module, _, name = (settings.python or "").partition(":")
    before = list(sys.path)
    sys.path.append(str(folder))  # last: what is installed goes first
    try:
        made: Optimiser = getattr(importlib.import_module(module), name)(**about)
    except (ImportError, AttributeError, TypeError, ValueError) as error:
        said = f"method.python '{settings.python}': {error}"
        hint = (
            f"Give module:Class, of a module that is installed or in {folder}; the class takes"
            " experiment and condition"
        )
        raise BadInputError("bad_optimiser", said, hint) from error
    finally:
        sys.path[:] = before
    return made
