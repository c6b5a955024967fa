"""A small SCPI-99 / IEEE 488.2 engine: the dialogue that simulated instruments have in common."""

from __future__ import annotations

import itertools
import math
import re
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

Write = Callable[[list[str]], None]
Query = Callable[[list[str]], str]

INFINITY = 9.9e37
ERROR_QUEUE_LENGTH = 20

_TEXTS = {
    -102: "Syntax error",
    -104: "Data type error",
    -108: "Parameter not allowed",
    -109: "Missing parameter",
    -113: "Undefined header",
    -123: "Exponent too large",
    -131: "Invalid suffix",
    -221: "Settings conflict",
    -222: "Data out of range; value clipped",
    -224: "Illegal parameter value",
    -350: "Queue overflow",
    720: "Output overload",
}
# Bits of the standard event status register (IEEE 488.2, 11.5.1).
_POWER_ON, _COMMAND, _EXECUTION, _DEVICE, _QUERY, _COMPLETE = 128, 32, 16, 8, 4, 1

_FIELD = {mark: re.compile(rf'(?:[^{mark}"]|"[^"]*")+') for mark in ";,"}
_UNIT = re.compile(
    r"(?P<root>:?)(?P<header>\*?[A-Za-z][A-Za-z0-9_:]*)(?P<query>\??)(?:\s+(?P<arguments>.*))?",
    re.DOTALL,
)
_NUMBER = re.compile(
    r"(?P<number>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(?P<suffix>[A-Za-z]*)"
)
_MULTIPLIERS = {"": 1.0, "G": 1e9, "MA": 1e6, "K": 1e3, "M": 1e-3, "U": 1e-6, "N": 1e-9}


class ScpiError(Exception):
    """Raised by a handler to refuse a command; `code` goes to the error queue."""

    def __init__(self, code: int) -> None:
        super().__init__(code, _TEXTS[code])
        self.code = code


@dataclass
class _Node:
    children: dict[str, _Node] = field(default_factory=dict)
    write: Write | None = None
    query: Query | None = None


class ScpiEngine:
    """Parses messages, walks the command tree, keeps errors and status; the instrument supplies
    handlers.

    `reset` is called for `*RST`, `executed` after every single command. Command errors (-1xx) end
    the message they occur in; execution errors do not. Thread-safe: one message at a time, under
    `lock`, which the instrument shares.
    """

    def __init__(
        self, identity: str, *, reset: Callable[[], None], executed: Callable[[], None]
    ) -> None:
        self.lock = threading.RLock()
        self._executed = executed
        self._root = _Node()
        self._errors: deque[int] = deque()
        self._event_status = _POWER_ON
        self._common: dict[str, _Node] = {
            "*IDN": _Node(query=lambda _: identity),
            "*OPT": _Node(query=lambda _: "0"),
            "*CLS": _Node(write=lambda _: self._clear_status()),
            "*RST": _Node(write=lambda _: reset()),
            "*WAI": _Node(write=lambda _: None),
            "*OPC": _Node(write=lambda _: self._set_event(_COMPLETE), query=lambda _: "1"),
            "*ESR": _Node(query=lambda _: self._take_event_status()),
            "*STB": _Node(query=lambda _: "4" if self._errors else "0"),
            "*TST": _Node(query=lambda _: "0"),
        }
        self.command("SYSTem:ERRor[:NEXT]", query=lambda _: self._next_error())
        self.command("SYSTem:VERSion", query=lambda _: "1999.0")

    def command(self, pattern: str, write: Write | None = None, query: Query | None = None) -> None:
        """Add a command in manual notation (`FREQuency`: upper case is the short form, `[:STATe]`
        may be left out).
        """
        for keywords in _spellings(pattern):
            node = self._root
            for keyword in keywords:
                child = node.children.get(keyword.upper()) or _Node()
                node.children[keyword.upper()] = node.children[short_form(keyword)] = child
                node = child
            node.write, node.query = write, query

    def handle(self, data: bytes) -> bytes:
        r"""Carry out messages (ended by `\n`, `\r\n` or `data`) and return one line of answers for
        each that asks.
        """
        with self.lock:
            answers = [self._message(message.decode("latin-1")) for message in data.split(b"\n")]
        return "".join(f"{answer}\n" for answer in answers if answer is not None).encode("latin-1")

    def post(self, code: int) -> None:
        """Put an error into the queue and its bit into the event status register."""
        self._set_event(_event_bit(code))
        if len(self._errors) < ERROR_QUEUE_LENGTH:
            self._errors.append(code)
        else:
            self._errors[-1] = -350
            self._set_event(_DEVICE)

    def _message(self, message: str) -> str | None:
        answers: list[str] = []
        subsystem = self._root
        for unit in _fields(message, ";"):
            if not unit.strip():
                continue
            try:
                subsystem, answer = self._execute(unit.strip(), subsystem)
            except ScpiError as error:
                self.post(error.code)
                if error.code > -200:
                    break
            else:
                answers += [] if answer is None else [answer]
            finally:
                self._executed()
        return ";".join(answers) if answers else None

    def _execute(self, unit: str, subsystem: _Node) -> tuple[_Node, str | None]:
        """Carry out one command; return the subsystem in which the next header is looked up, and
        the answer.
        """
        match = _UNIT.fullmatch(unit)
        if match is None:
            raise ScpiError(-102)
        header = match["header"].upper()
        if header.startswith("*"):
            node = self._common.get(header)
        else:
            subsystem, node = _find(self._root if match["root"] else subsystem, header.split(":"))
        arguments = [argument.strip() for argument in _fields(match["arguments"] or "", ",")]
        if node is not None and match["query"] and node.query is not None:
            return subsystem, node.query(arguments)
        if node is not None and not match["query"] and node.write is not None:
            node.write(arguments)
            return subsystem, None
        raise ScpiError(-113)

    def _next_error(self) -> str:
        code = self._errors.popleft() if self._errors else 0
        return f'{code:+d},"{_TEXTS.get(code, "No error")}"'

    def _clear_status(self) -> None:
        self._errors.clear()
        self._event_status = 0

    def _set_event(self, bit: int) -> None:
        self._event_status |= bit

    def _take_event_status(self) -> str:
        status, self._event_status = self._event_status, 0
        return str(status)


@lru_cache(maxsize=1024)
def short_form(keyword: str) -> str:
    """Return the short form of a keyword in manual notation: `FREQuency` -> `FREQ`."""
    return "".join(character for character in keyword if not character.islower())


def only(arguments: list[str]) -> str:
    """Return the single argument of a command; raises ScpiError -108 or -109."""
    if len(arguments) != 1:
        raise ScpiError(-108 if arguments else -109)
    return arguments[0]


def parse_choice(text: str, options: Sequence[str]) -> str:
    """Return the short form of the option (manual notation) that `text` names; raises ScpiError
    -224.
    """
    for option in options:
        if text.upper() in (option.upper(), short_form(option)):
            return short_form(option)
    raise ScpiError(-224)


def parse_boolean(text: str) -> bool:
    """Return what `1`, `0`, `ON` or `OFF` says; raises ScpiError -224."""
    return parse_choice(text, ("0", "1", "OFF", "ON")) in ("1", "ON")


def parse_named(text: str, named: Mapping[str, float]) -> float | None:
    """Return the value of the name (manual notation, e.g. `MINimum`) that `text` is, or None for
    other text.
    """
    return next(
        (
            value
            for name, value in named.items()
            if text.upper() in (name.upper(), short_form(name))
        ),
        None,
    )


def parse_number(text: str, unit: str = "", named: Mapping[str, float] | None = None) -> float:
    """Return a decimal number, with an optional suffix such as `kHz` for unit `HZ`, or the `named`
    value (`MIN`).

    `MHZ` and `MOHM` mean mega, any other M milli (SCPI-99 vol. 1, 7.3). Raises ScpiError -104, -123
    or -131.
    """
    if (value := parse_named(text, named or {})) is not None:
        return value
    match = _NUMBER.fullmatch(text)
    if match is None:
        raise ScpiError(-104)
    suffix = match["suffix"].upper()
    multiplier = suffix.removesuffix(unit) if suffix else ""
    if suffix in ("MHZ", "MOHM"):
        multiplier = "MA"
    if (suffix and not (unit and suffix.endswith(unit))) or multiplier not in _MULTIPLIERS:
        raise ScpiError(-131)
    value = float(match["number"]) * _MULTIPLIERS[multiplier]
    if math.isinf(value):
        raise ScpiError(-123)
    return value


def format_number(value: float) -> str:
    """Return NR3 as the 33220A writes it: `+5.0000000000000E+03`."""
    return f"{value:+.13E}"


def _find(node: _Node, keywords: list[str]) -> tuple[_Node, _Node | None]:
    """Return the subsystem that holds the last keyword, and its node if there is one."""
    subsystem, found = node, None
    for keyword in keywords:
        subsystem = node
        found = node.children.get(keyword)
        if found is None:
            break
        node = found
    return subsystem, found


def _fields(text: str, mark: str) -> list[str]:
    """Split at `mark`, but not inside quotes."""
    return (
        [field for field in text.split(mark) if field]
        if '"' not in text
        else _FIELD[mark].findall(text)
    )


@lru_cache(maxsize=1024)
def _spellings(pattern: str) -> list[list[str]]:
    """Return the keywords of a pattern with and without each of its optional parts."""
    parts = [part for part in re.split(r"(\[[^]]*\])", pattern) if part]
    choices = itertools.product(
        *(((part[1:-1], "") if part[0] == "[" else (part,)) for part in parts)
    )
    return [[keyword for keyword in "".join(chosen).split(":") if keyword] for chosen in choices]


def _event_bit(code: int) -> int:
    if code > 0:
        return _DEVICE
    return {1: _COMMAND, 2: _EXECUTION, 3: _DEVICE, 4: _QUERY}[-code // 100]
