"""The Agilent 33220A waveform generator: makes the carrier that the amplifier brings to the electrode."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from hw.errors import BadReply, DeviceError, InstrumentRejected, LimitExceeded
from hw.generator.arbitrary_waveform import CODE_HIGH, ArbitraryWaveform, Shape, Waveform
from hw.generator.dialogue import NOT_WHOLE, GeneratorDialogue
from hw.generator.gate import OutputGate
from hw.generator.settings import (
    AMPLITUDE_HIGH_VPP,
    AMPLITUDE_LOW_VPP,
    ARBITRARY_FREQUENCY_HIGH_HZ,
    Burst,
    ExternalModulation,
    GeneratorEvent,
    GeneratorSettings,
    GeneratorStatus,
    InternalModulation,
    Modulation,
    ModulationInput,
    RangePolicy,
    TriggerSource,
)
from hw.transport.contract import Transport

__all__ = [
    "AMPLITUDE_HIGH_VPP",
    "AMPLITUDE_LOW_VPP",
    "Agilent33220A",
    "ArbitraryWaveform",
    "Burst",
    "ExternalModulation",
    "GeneratorSettings",
    "GeneratorStatus",
    "InternalModulation",
    "ModulationInput",
    "RangePolicy",
    "Shape",
    "TriggerSource",
]

MODEL = "33220A"

# A value read back may differ by this share, or by the last of four digits at the low end (0.1 mV).
_LEVEL_TOLERANCE = 1e-3
_LEVEL_LSB_V = 1e-4
_FREQUENCY_TOLERANCE = 1e-6
_WAVEFORM_TOLERANCE = 1e-3
# OUTP:LOAD? answers 9.9e37 for INF; any finite load is at most 10 kohm.
_LOAD_INF_OHM = 9.9e37

# All that decides the peak at an open terminal, asked at each set point: somebody at the front panel, or a power
# cycle behind an interface that stays up, can bring LOAD 50 back; then VOLT? alone looks right at twice the voltage.
_STATE_QUERIES = ("FUNC?", "FREQ?", "VOLT?", "VOLT:OFFS?", "VOLT:UNIT?", "OUTP:LOAD?", "AM:STAT?")
_OFF_LINES = (("VOLT MIN", "VOLT:OFFS 0", "OUTP 0", "OUTP?"), ("OUTP 0", "OUTP?"))


class _Programmed(NamedTuple):
    """What the instrument is believed to hold."""

    waveform: Waveform
    modulation: Modulation | None
    frequency_hz: float
    amplitude_vpp: float
    offset_v: float


class Agilent33220A:
    """Driver of one 33220A that feeds a high-impedance amplifier.

    Voltages are peak volts at the electrode. Every change is read back and the instrument's error queue is
    asked in the same line, so a set point costs one round trip; a value that the instrument clipped or moved is an
    error. `APPLy` is never sent: it turns the output on. Every message also passes an `OutputGate`, which reckons
    the voltage again from the bytes alone. After a failed exchange nothing is believed any more, and the next
    command sets up everything again with the amplitude at its minimum (a generator that was switched off and on
    comes back with LOAD 50, which would double the voltage). Safe to call from several threads. Every method
    raises DeviceError unless it says otherwise.
    """

    def __init__(self, transport: Transport, settings: GeneratorSettings) -> None:
        self.settings = settings
        measured = settings.modulation_input
        gate = OutputGate(
            settings.volts_per_volt,
            settings.voltage_limit_v,
            modulation=None if measured is None else measured.amplitude_at_full_scale,
        )
        self._line = GeneratorDialogue(transport, gate, settings.reply_timeout_s)
        self._believed: _Programmed | None = None
        self._loaded: ArbitraryWaveform | None = None

    @property
    def minimum_voltage_v(self) -> float:
        """The lowest peak of a sine at the electrode that can be set; below it, switch the output off."""
        return 0.5 * AMPLITUDE_LOW_VPP * self.settings.volts_per_volt

    def connect(self) -> None:
        """Open, check the identity, switch off, reset, and set up a sine of minimum amplitude with the output off."""
        self._line.open()
        with self._forgetting_on_failure():
            identity = self._line.ask(["*IDN?"], 1)[0]
            if MODEL not in identity.split(","):
                raise self._line.bad_reply(f"is {identity!r}, not a {MODEL}", "check the address in the configuration")
            try:
                (output,) = self._line.ask(["OUTP 0", "*RST", "*CLS", "OUTP?"], 1)
                self._check_output(output, on=False)
                self._believed = self._set_up()
            except DeviceError:
                self.off()
                raise

    def set_point(
        self,
        frequency_hz: float,
        voltage_v: float,
        voltage_offset_v: float = 0.0,
        *,
        waveform: Waveform = Shape.SINE,
        modulation: Modulation | None = None,
    ) -> None:
        """Set what goes out; leaves the output on or off as it is, and sends only what changed.

        `voltage_v` is the largest magnitude of the waveform without offset, under modulation at its highest; for
        Shape.DC it is the voltage, and the frequency is ignored. When several change, the order is such that neither
        the peak nor voltage times frequency is in between above the larger of old and new. Another waveform or
        modulation is set up with the output off, and ends a burst; an arbitrary waveform is uploaded if it is not
        the one that `upload` sent last. Raises LimitExceeded, with nothing sent, for values that are not finite,
        outside `settings`, or outside what the generator can make (see `minimum_voltage_v`). What reads back
        otherwise, or was rejected, is switched off before BadReply or InstrumentRejected is raised.
        """
        wanted = self._wanted(frequency_hz, voltage_v, voltage_offset_v, waveform, modulation)
        with self._forgetting_on_failure():
            believed = self._believed or self._set_up()
            if wanted == believed:
                return
            was_on = False
            if wanted[:2] != believed[:2]:
                was_on = self._line.boolean(self._line.ask(["OUTP?"], 1)[0])
                believed = self._change_waveform(waveform, modulation)
            self._program(_changes(believed, wanted), wanted)
            self._believed = wanted
            if was_on:
                self.set_output(True)

    def upload(self, waveform: ArbitraryWaveform) -> None:
        """Store an arbitrary waveform and check that it arrived; switches the output off and leaves it off."""
        with self._forgetting_on_failure():
            self._believed = self._believed or self._set_up()
            self._believed = self._change_waveform(Shape.SINE, None)
            self._store(waveform)

    def set_burst(self, burst: Burst | None) -> None:
        """Wait for triggers and put out `burst` at each, or run on without (None). Not for Shape.DC or modulation."""
        with self._forgetting_on_failure():
            believed = self._believed = self._believed or self._set_up()
            if burst is None:
                (state,) = self._line.command(["BURS:STAT 0"], ["BURS:STAT?"])
                self._check_answers({"BURS:STAT?": state}, {"BURS:STAT?": "0"})
                return
            if believed.waveform is Shape.DC or believed.modulation is not None:
                raise LimitExceeded(
                    f"{self._line.resource}: a burst needs cycles and no modulation; nothing was sent",
                    "set a sine, a square or an arbitrary waveform first",
                )
            set_to = {"BURS:MODE": "TRIG", "BURS:NCYC": f"{burst.cycles}", "BURS:PHAS": "0"}
            set_to |= {"TRIG:SOUR": burst.trigger.value, "BURS:STAT": "1"}
            self._set_and_check(set_to)

    def trigger(self) -> None:
        """Start one burst; needs TriggerSource.BUS. Returns at once, the burst ends by itself."""
        with self._forgetting_on_failure():
            self._line.command(["*TRG"], [])

    def set_output(self, on: bool) -> None:
        """Switch the output and read it back; what is set up, and is read back first, goes out when `on`."""
        with self._forgetting_on_failure():
            if on:
                self._believed = self._believed or self._set_up()
                self._program([], self._believed)
            (output,) = self._line.command([f"OUTP {on:d}"], ["OUTP?"])
            self._check_output(output, on=on)

    def read_output(self) -> bool | None:
        """Ask whether the output is on; None when that cannot be known. Never raises DeviceError."""
        try:
            with self._forgetting_on_failure():
                return self._line.boolean(self._line.ask(["OUTP?"], 1)[0])
        except DeviceError:
            return None

    def read_status(self) -> GeneratorStatus:
        """Read and clear the event status and the error queue."""
        with self._forgetting_on_failure():
            events, status_byte = (int(self._line.number(text)) for text in self._line.ask(["*ESR?", "*STB?"], 2))
            return GeneratorStatus(GeneratorEvent(events & 255), status_byte, tuple(self._line.drain_errors()))

    def off(self) -> bool | None:
        """Levels to their minimum, output off, and ask whether it is off.

        Returns True: the instrument says off. False: it says on. None: it does not say. Never raises
        DeviceError; takes at most about four reply timeouts.
        """
        evidence = None
        for commands in _OFF_LINES:
            evidence = self._try_off(commands)
            if evidence:
                break
        return evidence

    def close(self) -> bool | None:
        """Switch off as `off` does, hang up, and return the evidence of `off`. Never raises DeviceError."""
        evidence = self.off()
        self._line.close()
        return evidence

    # --- setting up ----------------------------------------------------------------------------------------

    def _set_up(self) -> _Programmed:
        """Make a sine of minimum amplitude in volts peak to peak at an open terminal; the output stays as it is."""
        self._loaded = None
        fixed = self.settings.range_policy is RangePolicy.FIXED
        programmed = self._base()
        commands = ["VOLT MIN", "VOLT:OFFS 0", "AM:STAT 0", "BURS:STAT 0", "OUTP:LOAD INF", "VOLT:UNIT VPP", "FUNC SIN"]
        commands += ["VOLT MIN", "VOLT:OFFS 0", f"FREQ {programmed.frequency_hz:.12g}"]
        commands += [] if fixed else ["VOLT:RANG:AUTO ON"]
        autorange, output, *state = self._line.command(
            commands, ["VOLT:RANG:AUTO?", "OUTP?", *_queries(programmed.waveform)]
        )
        self._check_state(state, programmed)
        if fixed and self._line.boolean(autorange):
            self._fix_range(output)
        return programmed

    def _fix_range(self, output: str) -> None:
        """Visit the highest amplitude with the output off, since a range is kept as it is when ranging ends."""
        if self._line.boolean(output):
            self.off()
            raise self._line.bad_reply("is on and changes its range by itself", "somebody used it; connect again")
        high_vpp = 2.0 * self.settings.voltage_limit_v / self.settings.volts_per_volt
        high_vpp = min(max(high_vpp, AMPLITUDE_LOW_VPP), AMPLITUDE_HIGH_VPP)
        autorange, output, *state = self._line.command(
            ["OUTP 0", f"VOLT {high_vpp:.12g}", "VOLT:RANG:AUTO OFF", "VOLT MIN"],
            ["VOLT:RANG:AUTO?", "OUTP?", *_STATE_QUERIES],
        )
        self._check_answers({"VOLT:RANG:AUTO?": autorange}, {"VOLT:RANG:AUTO?": "0"})
        self._check_output(output, on=False)
        self._check_state(state, self._base())

    def _base(self) -> _Programmed:
        """From here every waveform and modulation can be reached without a conflict."""
        return _Programmed(Shape.SINE, None, self.settings.frequency_low_hz, AMPLITUDE_LOW_VPP, 0.0)

    def _change_waveform(self, waveform: Waveform, modulation: Modulation | None) -> _Programmed:
        """Change over with the output off and all levels at their minimum; the output stays off."""
        base = self._base()
        commands = ["OUTP 0", "VOLT MIN", "VOLT:OFFS 0", "AM:STAT 0", "BURS:STAT 0", "FUNC SIN"]
        commands += ["VOLT MIN", "VOLT:OFFS 0", f"FREQ {base.frequency_hz:.12g}"]
        output, *state = self._line.command(commands, ["OUTP?", *_STATE_QUERIES])
        self._check_output(output, on=False)
        self._check_state(state, base)
        if isinstance(waveform, ArbitraryWaveform):
            if waveform is not self._loaded:
                self._store(waveform)
            self._set_and_check({"FUNC:USER": "VOLATILE"})
        if waveform is not Shape.SINE:
            self._set_and_check({"FUNC": waveform.function})
        if modulation is not None:
            self._set_and_check(_modulation_commands(modulation))
        return base._replace(waveform=waveform, modulation=modulation)

    def _store(self, waveform: ArbitraryWaveform) -> None:
        """Upload and check length, span and mean: swapped or lost bytes show in them."""
        self._loaded = None
        binary = self.settings.binary_upload
        if binary:
            self._set_and_check({"FORM:BORD": "NORM"})
        self._line.send(waveform.upload_command(binary=binary))
        self._line.command([], [], self.settings.upload_timeout_s)
        answers = self._line.command([], [f"DATA:ATTR:{what}? VOLATILE" for what in ("POIN", "PTP", "AVER")])
        points, span, mean = map(self._line.number, answers)
        wanted_mean = float(waveform.codes_raw.mean(dtype=np.float64)) / CODE_HIGH
        # Whether the span counts from 0 to 1 or, between -1 and 1, to 2 is not verified.
        spans = any(math.isclose(span, full, rel_tol=_WAVEFORM_TOLERANCE) for full in (1.0, 2.0))
        if not (points == waveform.codes_raw.size and spans and abs(mean - wanted_mean) <= _WAVEFORM_TOLERANCE):
            raise self._line.bad_reply(
                f"holds a waveform of {points:g} points, span {span:g}, mean {mean:g} where "
                f"{waveform.codes_raw.size} points, full span, mean {wanted_mean:g} were sent",
                "the upload was spoilt on its way; try binary_upload = false",
            )
        self._loaded = waveform

    def _set_and_check(self, settings: dict[str, str]) -> None:
        """Set each header to its value, in this order, and read all of them back."""
        queries = [f"{header}?" for header in settings]
        answers = self._line.command([f"{header} {value}" for header, value in settings.items()], queries)
        self._check_answers(
            dict(zip(queries, answers, strict=True)), dict(zip(queries, settings.values(), strict=True))
        )

    def _try_off(self, commands: Sequence[str]) -> bool | None:
        timeout_s = self.settings.reply_timeout_s
        try:
            with self._line.undisturbed(timeout_s):
                self._believed = None
                return not self._line.boolean(self._line.ask(commands, 1)[0])
        except DeviceError:
            return None

    def _program(self, commands: Sequence[str], wanted: _Programmed) -> None:
        """Send commands after which `wanted` is to be there; switches off unless it is."""
        try:
            state = self._line.command(commands, _queries(wanted.waveform))
        except InstrumentRejected:
            self.off()
            raise
        self._check_state(state, wanted)

    # --- limits and checks ---------------------------------------------------------------------------------

    def _wanted(
        self,
        frequency_hz: float,
        voltage_v: float,
        voltage_offset_v: float,
        waveform: Waveform,
        modulation: Modulation | None,
    ) -> _Programmed:
        """Return what to program for a set point; raises LimitExceeded."""
        settings, gain, is_dc = self.settings, self.settings.volts_per_volt, waveform is Shape.DC
        modulation_gain = self._modulation_gain(waveform, modulation)
        shape_vpp = waveform.high - waveform.low  # at a largest magnitude of 1 V
        least_v = 0.0 if is_dc else AMPLITUDE_LOW_VPP * gain / shape_vpp * modulation_gain
        generator_high_v = 0.5 * AMPLITUDE_HIGH_VPP * gain
        high_v = min(settings.voltage_limit_v, generator_high_v)
        peak_v, programmed_v = (
            max(abs(voltage_offset_v + largest_v * level) for level in (waveform.low, waveform.high))
            for largest_v in (voltage_v, voltage_v / modulation_gain)
        )
        frequency_hz = settings.frequency_low_hz if is_dc else frequency_hz
        is_arbitrary = isinstance(waveform, ArbitraryWaveform)
        frequency_high_hz = min(settings.frequency_high_hz, ARBITRARY_FREQUENCY_HIGH_HZ if is_arbitrary else math.inf)
        for what, value, low, high in (
            ("Hz", frequency_hz, settings.frequency_low_hz, frequency_high_hz),
            ("V at the electrode", voltage_v, least_v, high_v),
            ("V at the electrode, offset included,", peak_v, 0.0, high_v),
            ("V to be programmed before modulation takes its part", programmed_v, 0.0, generator_high_v),
        ):
            if not low <= value <= high:
                raise LimitExceeded(
                    f"{self._line.resource}: {value:g} {what} is outside {low:g}..{high:g}; nothing was sent",
                    "stay within the limits; for zero volts switch the output off",
                )
        amplitude_vpp = voltage_v * shape_vpp / gain / modulation_gain
        offset_v = (voltage_offset_v + 0.5 * voltage_v * (waveform.high + waveform.low)) / gain
        return _Programmed(waveform, modulation, frequency_hz, max(amplitude_vpp, AMPLITUDE_LOW_VPP), offset_v)

    def _modulation_gain(self, waveform: Waveform, modulation: Modulation | None) -> float:
        """Return the highest amplitude under modulation over the one programmed; raises LimitExceeded."""
        if modulation is None:
            return 1.0
        measured = self.settings.modulation_input
        if measured is None:
            raise LimitExceeded(
                f"{self._line.resource}: what modulation does to the amplitude is not set; nothing was sent",
                "measure Modulation In and set modulation_input",
            )
        if waveform.low != -1.0 or waveform.high != 1.0:
            raise LimitExceeded(
                f"{self._line.resource}: modulation needs a waveform that swings evenly about zero; nothing was sent",
                "use a sine, a square, or an arbitrary waveform with equal extremes",
            )
        depth = modulation.depth if isinstance(modulation, InternalModulation) else 1.0
        return 0.5 * measured.amplitude_at_full_scale * (1.0 + depth)

    def _check_state(self, answers: Sequence[str], wanted: _Programmed) -> None:
        """Compare answers to `_queries`; what is not as set may be any voltage, so it is switched off."""
        queries = _queries(wanted.waveform)
        shown = dict(zip(queries, answers, strict=True))
        try:
            as_set = (
                shown["FUNC?"] == wanted.waveform.function
                and _near(self._line.number(shown.get("FREQ?", "0")), _frequency(wanted), _FREQUENCY_TOLERANCE)
                and _near(self._line.number(shown["VOLT?"]), wanted.amplitude_vpp, _LEVEL_TOLERANCE, _LEVEL_LSB_V)
                and _near(self._line.number(shown["VOLT:OFFS?"]), wanted.offset_v, _LEVEL_TOLERANCE, _LEVEL_LSB_V)
                and shown["VOLT:UNIT?"] == "VPP"
                and self._line.number(shown["OUTP:LOAD?"]) >= _LOAD_INF_OHM
                and self._line.boolean(shown["AM:STAT?"]) is (wanted.modulation is not None)
            )
        except BadReply:
            as_set = False
        if not as_set:
            self.off()
            raise self._line.bad_reply(
                f"holds {', '.join(f'{query} {answer}' for query, answer in shown.items())} where "
                f"{wanted.waveform.function}, {wanted.frequency_hz:g} Hz, {wanted.amplitude_vpp:g} VPP, "
                f"offset {wanted.offset_v:g} V and an open load were set",
                NOT_WHOLE,
            )

    def _check_answers(self, shown: dict[str, str], wanted: dict[str, str]) -> None:
        """Compare answers with what was set; what is not as set is switched off."""
        for query, value in wanted.items():
            if not self._says(shown[query], value):
                self.off()
                raise self._line.bad_reply(f"answers {shown[query]} to {query} where {value} was set", NOT_WHOLE)

    def _says(self, answer: str, value: str) -> bool:
        """Words are compared by themselves and numbers by value."""
        if answer == value or not value[:1].isdigit():
            return answer == value
        try:
            return _near(self._line.number(answer), float(value), _LEVEL_TOLERANCE)
        except BadReply:
            return False

    def _check_output(self, reply: str, *, on: bool) -> None:
        if self._line.boolean(reply) is not on:
            raise self._line.bad_reply(
                f"has its output {'off' if on else 'on'} after being told otherwise",
                "look at the instrument: an overload switches its output off",
            )

    @contextmanager
    def _forgetting_on_failure(self) -> Iterator[None]:
        """Hold the transport; after any failure the state of the instrument is unknown."""
        with self._line.undisturbed():
            try:
                yield
            except BaseException:
                self._believed = None
                raise


def _queries(waveform: Waveform) -> list[str]:
    """What to ask about a waveform; a constant voltage has no frequency."""
    return [query for query in _STATE_QUERIES if query != "FREQ?" or waveform is not Shape.DC]


def _frequency(programmed: _Programmed) -> float:
    return 0.0 if programmed.waveform is Shape.DC else programmed.frequency_hz


def _near(value: float, wanted: float, share: float, least: float = 0.0) -> bool:
    return abs(value - wanted) <= max(share * abs(wanted), least)


def _modulation_commands(modulation: Modulation) -> dict[str, str]:
    if isinstance(modulation, ExternalModulation):
        return {"AM:SOUR": "EXT", "AM:DEPT": "100", "AM:STAT": "1"}
    return {
        "AM:SOUR": "INT",
        "AM:INT:FUNC": "SIN",
        "AM:INT:FREQ": f"{modulation.frequency_hz:.12g}",
        "AM:DEPT": f"{100.0 * modulation.depth:.12g}",
        "AM:STAT": "1",
    }


def _changes(old: _Programmed, new: _Programmed) -> list[str]:
    """Return the commands from `old` to `new`: a falling amplitude goes before all else, a rising one after.

    So no step is above the larger of both peaks, nor conflicts with the instrument's limit on their sum.
    """
    commands = [] if new.offset_v == old.offset_v else [f"VOLT:OFFS {new.offset_v:.12g}"]
    if new.frequency_hz != old.frequency_hz and new.waveform is not Shape.DC:
        commands.append(f"FREQ {new.frequency_hz:.12g}")
    if new.amplitude_vpp != old.amplitude_vpp:
        falling = new.amplitude_vpp < old.amplitude_vpp
        commands.insert(0 if falling else len(commands), f"VOLT {new.amplitude_vpp:.12g}")
    return commands
