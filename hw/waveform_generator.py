"""The Agilent 33220A waveform generator: makes the carrier that the amplifier brings to the electrode."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple

from hw.errors import BadReply, DeviceError, InstrumentRejected, LimitExceeded
from hw.transport.contract import Transport

MODEL = "33220A"

# Sine limits into an open circuit, OUTP:LOAD INF (33220A data sheet: 10 mVpp to 10 Vpp into 50 ohm, doubled open).
AMPLITUDE_LOW_VPP = 0.02
AMPLITUDE_HIGH_VPP = 20.0
FREQUENCY_LOW_HZ = 1e-6
FREQUENCY_HIGH_HZ = 20e6

# An amplitude read back may differ by this share, or by the last of four digits at the low end (0.1 mVpp).
_AMPLITUDE_TOLERANCE = 1e-3
_AMPLITUDE_LSB_VPP = 1e-4
# OUTP:LOAD? answers 9.9e37 for INF; any finite load is at most 10 kohm.
_LOAD_INF_OHM = 9.9e37
_ERROR_QUEUE_LENGTH = 20

# All that decides the peak at an open terminal, asked at each set point: somebody at the front panel, or a power
# cycle behind an interface that stays up, can bring LOAD 50 back; then VOLT? alone looks right at twice the voltage.
_LEVEL_QUERIES = ("VOLT?", "VOLT:OFFS?", "VOLT:UNIT?", "OUTP:LOAD?")

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_ERROR = re.compile(r'(?P<code>[+-]?\d{1,5}),".*"')
_FIELD = re.compile(r'(?:[^;"]|"[^"]*")+')
_NOT_WHOLE = "the answer is garbled or the settings were changed at the front panel; connect again"


@dataclass(frozen=True)
class GeneratorSettings:
    """How the generator is wired, and what it may ask of the electrode.

    `volts_per_volt` is electrode volts per volt at the generator's terminals (the amplifier's gain);
    `voltage_limit_v` is the peak at the electrode. Raises ValueError for numbers that make no sense.
    """

    volts_per_volt: float
    voltage_limit_v: float
    frequency_low_hz: float
    frequency_high_hz: float
    reply_timeout_s: float = 1.0

    def __post_init__(self) -> None:
        """Refuse what cannot be a setting."""
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"generator {name} must be a finite number > 0, not {value!r}")
        if not FREQUENCY_LOW_HZ <= self.frequency_low_hz <= self.frequency_high_hz <= FREQUENCY_HIGH_HZ:
            raise ValueError(
                f"generator frequency range {self.frequency_low_hz:g}..{self.frequency_high_hz:g} Hz must be ordered "
                f"and within {FREQUENCY_LOW_HZ:g}..{FREQUENCY_HIGH_HZ:g} Hz"
            )


class _Programmed(NamedTuple):
    """What the instrument is believed to hold; frequency None means not set by us."""

    frequency_hz: float | None
    amplitude_vpp: float


class Agilent33220A:
    """Driver of one 33220A that feeds a high-impedance amplifier with a sine.

    Voltages are peak volts at the electrode. Every change is read back and the instrument's error queue is
    asked in the same line, so a set point costs one round trip. `APPLy` is never sent: it turns the output on.
    After a failed exchange nothing is believed any more, and the next command sets up everything again with
    the amplitude at its minimum (a generator that was switched off and on comes back with LOAD 50, which
    would double the voltage). Safe to call from several threads. Every method raises DeviceError unless it
    says otherwise.
    """

    def __init__(self, transport: Transport, settings: GeneratorSettings) -> None:
        self.settings = settings
        self._transport = transport
        self._believed: _Programmed | None = None

    @property
    def minimum_voltage_v(self) -> float:
        """The lowest peak voltage at the electrode that can be set; below it, switch the output off."""
        return 0.5 * AMPLITUDE_LOW_VPP * self.settings.volts_per_volt

    def connect(self) -> None:
        """Open, check the identity, switch off, reset, and set up a sine of minimum amplitude with the output off."""
        self._transport.open()
        with self._forgetting_on_failure():
            identity = self._ask("*IDN?", 1)[0]
            if MODEL not in identity.split(","):
                raise self._bad_reply(f"is {identity!r}, not a {MODEL}", "check the address in the configuration")
            try:
                (output,) = self._ask("OUTP 0;*RST;*CLS;:OUTP?", 1)
                self._check_output(output, on=False)
                self._believed = self._set_up()
            except DeviceError:
                self.off()
                raise

    def set_point(self, frequency_hz: float, voltage_v: float) -> None:
        """Set the carrier; leaves the output on or off as it is, and sends only what changed.

        When both change, the order is such that neither the voltage nor voltage times frequency is in between
        above the larger of old and new. Raises LimitExceeded, with nothing sent, for values that are not finite,
        outside `settings`, or outside what the generator can make (see `minimum_voltage_v`). Levels that read
        back otherwise are switched off before BadReply is raised.
        """
        self._check_limits(frequency_hz, voltage_v)
        amplitude_vpp = max(2.0 * voltage_v / self.settings.volts_per_volt, AMPLITUDE_LOW_VPP)
        with self._forgetting_on_failure():
            believed = self._believed or self._set_up()
            wanted = _Programmed(frequency_hz, amplitude_vpp)
            if wanted == believed:
                return
            levels = self._command(_changes(believed, wanted), _LEVEL_QUERIES)
            self._check_levels(levels, amplitude_vpp)
            self._believed = wanted

    def set_output(self, on: bool) -> None:
        """Switch the output and read it back; what is set up, and is read back first, goes out when `on`."""
        with self._forgetting_on_failure():
            if on:
                self._believed = self._believed or self._set_up()
                self._check_levels(self._command([], _LEVEL_QUERIES), self._believed.amplitude_vpp)
            (output,) = self._command([f"OUTP {on:d}"], ["OUTP?"])
            self._check_output(output, on=on)

    def read_output(self) -> bool | None:
        """Ask whether the output is on; None when that cannot be known. Never raises DeviceError."""
        try:
            with self._forgetting_on_failure():
                return self._boolean(self._ask("OUTP?", 1)[0])
        except DeviceError:
            return None

    def off(self) -> bool | None:
        """Amplitude to its minimum, output off, and ask whether it is off.

        Returns True: the instrument says off. False: it says on. None: it does not say. Never raises
        DeviceError; takes at most about four reply timeouts.
        """
        evidence = None
        for commands in ("VOLT MIN;:OUTP 0;:OUTP?", "OUTP 0;:OUTP?"):
            evidence = self._try_off(commands)
            if evidence:
                break
        return evidence

    def close(self) -> bool | None:
        """Switch off as `off` does, hang up, and return the evidence of `off`. Never raises DeviceError."""
        evidence = self.off()
        self._transport.close()
        return evidence

    def _set_up(self) -> _Programmed:
        """Make a sine of minimum amplitude in volts peak to peak at an open terminal; the output stays as it is."""
        function, *levels = self._command(
            ["VOLT MIN", "OUTP:LOAD INF", "VOLT:UNIT VPP", "FUNC SIN", "VOLT MIN", "VOLT:OFFS 0"],
            ["FUNC?", *_LEVEL_QUERIES],
        )
        if function != "SIN":
            raise self._bad_reply(f"answers function {function} where SIN was set", _NOT_WHOLE)
        self._check_levels(levels, AMPLITUDE_LOW_VPP)
        return _Programmed(None, AMPLITUDE_LOW_VPP)

    def _try_off(self, commands: str) -> bool | None:
        timeout_s = self.settings.reply_timeout_s
        try:
            with self._transport.exchange(timeout_s):
                self._believed = None
                return not self._boolean(self._ask(commands, 1)[0])
        except DeviceError:
            return None

    def _command(self, commands: Sequence[str], queries: Sequence[str]) -> list[str]:
        """Send commands, queries and the question for errors as one line; return the answers to the queries."""
        fields = self._ask(";:".join([*commands, *queries, "SYST:ERR?"]), len(queries) + 1)
        if self._error_code(fields[-1]) != 0:
            raise InstrumentRejected(
                f"{self._transport.resource} rejected {';'.join(commands)!r}: {', '.join(self._errors(fields[-1]))}",
                "check the requested values against the instrument's ranges",
            )
        return fields[:-1]

    def _errors(self, first: str) -> list[str]:
        """Return `first` and empty the instrument's queue behind it, so that no later command is blamed."""
        errors = [first]
        while len(errors) <= _ERROR_QUEUE_LENGTH:
            (error,) = self._ask("SYST:ERR?", 1)
            if self._error_code(error) == 0:
                break
            errors.append(error)
        return errors

    def _ask(self, line: str, count: int) -> list[str]:
        """Send one line and return the `count` fields of its one answer line."""
        reply = self._transport.query(line.encode("ascii") + b"\n", self.settings.reply_timeout_s)
        fields: list[str] = _FIELD.findall(reply.decode("ascii", errors="replace").strip())
        if len(fields) != count:
            raise self._bad_reply(f"answered {reply[:80]!r} to {line!r}", _NOT_WHOLE)
        return fields

    def _check_limits(self, frequency_hz: float, voltage_v: float) -> None:
        settings = self.settings
        voltage_high_v = min(settings.voltage_limit_v, 0.5 * AMPLITUDE_HIGH_VPP * settings.volts_per_volt)
        for what, value, low, high in (
            ("Hz", frequency_hz, settings.frequency_low_hz, settings.frequency_high_hz),
            ("V at the electrode", voltage_v, self.minimum_voltage_v, voltage_high_v),
        ):
            if not low <= value <= high:
                raise LimitExceeded(
                    f"{self._transport.resource}: {value:g} {what} is outside {low:g}..{high:g}; nothing was sent",
                    "stay within the limits; for zero volts switch the output off",
                )

    def _check_levels(self, levels: Sequence[str], expected_vpp: float) -> None:
        """Compare answers to `_LEVEL_QUERIES`; what is not as set may be any voltage, so it is switched off."""
        amplitude, offset, unit, load = levels
        tolerance_vpp = max(_AMPLITUDE_TOLERANCE * expected_vpp, _AMPLITUDE_LSB_VPP)
        try:
            as_set = (
                abs(self._number(amplitude) - expected_vpp) <= tolerance_vpp
                and abs(self._number(offset)) <= _AMPLITUDE_LSB_VPP
                and unit == "VPP"
                and self._number(load) >= _LOAD_INF_OHM
            )
        except BadReply:
            as_set = False
        if not as_set:
            self.off()
            raise self._bad_reply(
                f"holds {amplitude} {unit}, offset {offset} V for a load of {load} ohm "
                f"where {expected_vpp:g} VPP, no offset and an open load were set",
                _NOT_WHOLE,
            )

    def _check_output(self, reply: str, *, on: bool) -> None:
        if self._boolean(reply) is not on:
            raise self._bad_reply(
                f"has its output {'off' if on else 'on'} after being told otherwise",
                "look at the instrument: an overload switches its output off",
            )

    def _boolean(self, text: str) -> bool:
        if text not in ("0", "1"):
            raise self._bad_reply(f"answered {text!r} where 0 or 1 was expected", _NOT_WHOLE)
        return text == "1"

    def _number(self, text: str) -> float:
        if not _NUMBER.fullmatch(text):
            raise self._bad_reply(f"answered {text!r} where a number was expected", _NOT_WHOLE)
        return float(text)

    def _error_code(self, text: str) -> int:
        match = _ERROR.match(text)
        if match is None:
            raise self._bad_reply(f"answered {text!r} where an error was asked for", _NOT_WHOLE)
        return int(match["code"])

    def _bad_reply(self, what: str, hint: str) -> BadReply:
        self._transport.mark_dirty()
        return BadReply(f"{self._transport.resource} {what}", hint)

    @contextmanager
    def _forgetting_on_failure(self) -> Iterator[None]:
        """Hold the transport; after any failure the state of the instrument is unknown."""
        with self._transport.exchange():
            try:
                yield
            except BaseException:
                self._believed = None
                raise


def _changes(old: _Programmed, new: _Programmed) -> list[str]:
    """Return the commands from `old` to `new`: a falling amplitude goes before the frequency, a rising one after."""
    commands = [] if new.frequency_hz == old.frequency_hz else [f"FREQ {new.frequency_hz:.12g}"]
    if new.amplitude_vpp != old.amplitude_vpp:
        falling = new.amplitude_vpp < old.amplitude_vpp
        commands.insert(0 if falling else len(commands), f"VOLT {new.amplitude_vpp:.12g}")
    return commands
