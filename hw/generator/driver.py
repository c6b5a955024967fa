"""What drivers of waveform generators have in common: limits, belief and distrust, the way off."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from typing import ClassVar, NamedTuple

from hw.errors import DeviceError, LimitExceeded
from hw.generator.contract import GeneratorReport
from hw.generator.dialogue import GeneratorDialogue
from hw.generator.settings import ExternalModulation, GeneratorSettings, Shape
from hw.setting import Setting


class Programmed(NamedTuple):
    """What the instrument is believed to hold, or is to hold."""

    shape: Shape
    modulation: ExternalModulation | None
    frequency_hz: float
    amplitude_vpp: float
    offset_v: float


class GeneratorDriver(ABC):
    """Driver of one generator that feeds a high-impedance amplifier; a subclass speaks the
    instrument's dialect.

    Voltages are peak volts at the electrode. After a failed exchange nothing is believed any more,
    and the next command sets up everything again with the amplitude at its minimum. Safe to call
    from several threads. Every method raises DeviceError unless it says otherwise.
    """

    model: ClassVar[re.Pattern[str]]  # of the second field of *IDN?
    amplitude_low_vpp: ClassVar[float]  # into an open circuit
    amplitude_high_vpp: ClassVar[float]
    shapes: ClassVar[frozenset[Shape]] = frozenset({Shape.SINE})
    external_modulation: ClassVar[bool] = False
    limits_itself: ClassVar[bool] = False  # the instrument is given the limit, and refuses more

    def __init__(self, line: GeneratorDialogue, settings: GeneratorSettings) -> None:
        self.settings = settings
        self._dialogue = line
        self._believed: Programmed | None = None

    @abstractmethod
    def _ask_state(self) -> tuple[bool, bool, str]:
        """Only ask: whether the output is on, whether levels are for an open circuit, and what is
        set, in words.
        """

    def _ask_held(self) -> list[Setting]:
        """Only ask: what the driver sets at connecting, and what is set now."""
        return []

    @abstractmethod
    def _reset(self) -> None:
        """Output off, then everything as it leaves the factory; raises BadReply unless it says
        off.
        """

    @abstractmethod
    def _set_up(self) -> None:
        """Make it `_base()`, with levels in volts into an open circuit; the output stays as it is,
        or goes off.
        """

    def _change_waveform(self, wanted: Programmed) -> None:
        """Go to `_base()` with the output off, and from there to shape and modulation; where there
        are several.
        """
        raise NotImplementedError

    @abstractmethod
    def _program(self, believed: Programmed, wanted: Programmed) -> None:
        """Send what differs, a falling amplitude first and a rising one last, and read all back.

        What reads back otherwise is switched off before BadReply is raised.
        """

    @abstractmethod
    def _ask_output(self) -> bool:
        """Whether the output is on."""

    @abstractmethod
    def _switch(self, on: bool) -> bool:
        """Switch the output, and return whether it is on then. Raises InstrumentRejected where the
        instrument reports an error.
        """

    @abstractmethod
    def _try_off(self, *, levels: bool) -> bool:
        """Off, with all levels lowered first if `levels`, and whether the output is on now."""

    @property
    def minimum_voltage_v(self) -> float:
        """The lowest peak of a sine at the electrode that can be set; below it, switch the output
        off.
        """
        return 0.5 * self.amplitude_low_vpp * self.settings.volts_per_volt

    def identify(self) -> GeneratorReport:
        """Open, and only ask."""
        self._dialogue.open()
        with self._forgetting_on_failure():
            maker, model, serial_number, firmware = self._check_identity()
            state, held = self._ask_state(), tuple(self._ask_held())
            return GeneratorReport(f"{maker} {model}", serial_number, firmware, *state, held)

    def held(self) -> list[Setting]:
        """Only ask: what is set at connecting, and what is set now."""
        with self._forgetting_on_failure():
            return self._ask_held()

    def connect(self) -> None:
        """Open, check the identity, switch off, reset, and set up a sine of minimum amplitude with
        the output off.
        """
        self._dialogue.open()
        with self._forgetting_on_failure():
            self._check_identity()
            try:
                self._reset()
                self._set_up()
            except DeviceError:
                self.off()
                raise
            self._believed = self._base()

    def set_point(
        self,
        frequency_hz: float,
        voltage_v: float,
        voltage_offset_v: float = 0.0,
        *,
        shape: Shape = Shape.SINE,
        modulation: ExternalModulation | None = None,
    ) -> None:
        """Set what goes out; leaves the output on or off as it is, and sends only what changed.

        `voltage_v` is the amplitude, under modulation at its highest; for Shape.DC it is the
        voltage, and the frequency is ignored. No step in between is above the larger of both peaks.
        Another shape or modulation is set up with the output off. Raises LimitExceeded, with
        nothing sent, for values that are not finite, outside `settings`, or outside what the
        generator can make (see `minimum_voltage_v`).
        """
        wanted = self._wanted(frequency_hz, voltage_v, voltage_offset_v, shape, modulation)
        with self._forgetting_on_failure():
            believed = self._believe()
            if wanted == believed:
                return
            was_on = False
            if wanted[:2] != believed[:2]:
                was_on = self._ask_output()
                self._change_waveform(wanted)
                believed = self._base()._replace(shape=shape, modulation=modulation)
            self._program(believed, wanted)
            self._believed = wanted
            if was_on:
                self.set_output(True)

    def set_output(self, on: bool) -> None:
        """Switch the output and read it back; what is set up, and is read back first, goes out when
        `on`.
        """
        with self._forgetting_on_failure():
            if on:
                believed = self._believe()
                self._program(believed, believed)
            self._check_output(self._switch(on), on=on)

    def is_on(self) -> bool:
        """Ask whether the output is on, whoever switched it."""
        with self._forgetting_on_failure():
            return self._ask_output()

    def off(self) -> bool | None:
        """Levels to their minimum, output off, and ask whether it is off; at second try the output
        alone.

        Returns True: the instrument says off. False: it says on. None: it does not say. Never
        raises DeviceError; takes at most about four reply timeouts.
        """
        evidence = None
        for levels in (True, False):
            try:
                with self._dialogue.undisturbed(self.settings.reply_timeout_s):
                    self._believed = None
                    evidence = not self._try_off(levels=levels)
            except DeviceError:
                evidence = None
            if evidence:
                break
        return evidence

    def close(self) -> bool | None:
        """Switch off as `off` does, hang up, and return the evidence of `off`. Never raises
        DeviceError.
        """
        evidence = self.off()
        self._dialogue.close()
        return evidence

    def _base(self) -> Programmed:
        """From here every waveform and modulation can be reached without a conflict."""
        return Programmed(
            Shape.SINE, None, self.settings.frequency_low_hz, self.amplitude_low_vpp, 0.0
        )

    def _believe(self) -> Programmed:
        """What the instrument holds; set up anew where nothing is believed."""
        if self._believed is None:
            self._set_up()
            self._believed = self._base()
        return self._believed

    def _wanted(
        self,
        frequency_hz: float,
        voltage_v: float,
        voltage_offset_v: float,
        shape: Shape,
        modulation: ExternalModulation | None,
    ) -> Programmed:
        """Return what to program for a set point; raises LimitExceeded."""
        settings, gain, is_dc = self.settings, self.settings.volts_per_volt, shape is Shape.DC
        factor = self._modulation_factor(shape, modulation)
        highest_v = 0.5 * self.amplitude_high_vpp * gain
        limit_v = min(settings.voltage_limit_v, highest_v)
        frequency_hz = settings.frequency_low_hz if is_dc else frequency_hz
        peak_v, programmed_v = (
            abs(voltage_v + voltage_offset_v) if is_dc else abs(voltage_offset_v) + amplitude_v
            for amplitude_v in (voltage_v, voltage_v / factor)
        )
        for what, value, low, high in (
            ("Hz", frequency_hz, settings.frequency_low_hz, settings.frequency_high_hz),
            (
                "V at the electrode",
                voltage_v,
                0.0 if is_dc else self.minimum_voltage_v * factor,
                limit_v,
            ),
            ("V at the electrode, offset included,", peak_v, 0.0, limit_v),
            (
                "V to be programmed before modulation takes its part",
                programmed_v,
                0.0,
                limit_v if self.limits_itself else highest_v,
            ),
        ):
            if not low <= value <= high:
                raise LimitExceeded(
                    f"{self._dialogue.resource}: {value:g} {what} is outside {low:g}..{high:g};"
                    " nothing was sent",
                    "stay within the limits; for zero volts switch the output off",
                )
        if is_dc:
            return Programmed(
                shape,
                modulation,
                frequency_hz,
                self.amplitude_low_vpp,
                (voltage_v + voltage_offset_v) / gain,
            )
        amplitude_vpp = max(2.0 * voltage_v / gain / factor, self.amplitude_low_vpp)
        return Programmed(shape, modulation, frequency_hz, amplitude_vpp, voltage_offset_v / gain)

    def _modulation_factor(self, shape: Shape, modulation: ExternalModulation | None) -> float:
        """Return the highest amplitude under modulation over the one programmed; raises
        LimitExceeded.
        """
        measured = self.settings.modulation_input
        if shape not in self.shapes or (modulation is not None and not self.external_modulation):
            what = (
                f"makes no {shape.value}"
                if shape not in self.shapes
                else "is not modulated by this driver"
            )
            raise LimitExceeded(
                f"{self._dialogue.resource} {what}; nothing was sent", "use another generator"
            )
        if modulation is None:
            return 1.0
        if measured is None:
            raise LimitExceeded(
                f"{self._dialogue.resource}: what modulation does to the amplitude is not set;"
                " nothing was sent",
                "measure Modulation In and set modulation_input",
            )
        if shape is Shape.DC:
            raise LimitExceeded(
                f"{self._dialogue.resource}: modulation needs a waveform that swings; nothing was"
                " sent",
                "use a sine",
            )
        return measured.amplitude_at_full_scale

    def _check_identity(self) -> list[str]:
        """Return maker, model, serial number and firmware; raises BadReply for another model."""
        identity = self._dialogue.query("*IDN?")
        fields = [text.strip() for text in (identity + ",,,").split(",")[:4]]
        if not self.model.fullmatch(fields[1]):
            raise self._dialogue.bad_reply(
                f"is {identity!r}, not a {self.model.pattern}",
                "check address and model in the configuration",
            )
        return fields

    def _check_output(self, shown: bool, *, on: bool) -> None:
        if shown is not on:
            raise self._dialogue.bad_reply(
                f"has its output {'off' if on else 'on'} after the opposite order",
                "look at the instrument: an overload switches its output off",
            )

    @contextmanager
    def _forgetting_on_failure(self) -> Iterator[None]:
        """Hold the transport; after any failure the state of the instrument is unknown."""
        with self._dialogue.undisturbed():
            try:
                yield
            except BaseException:
                self._believed = None
                raise


def near(value: float, wanted: float, share: float, least: float = 0.0) -> bool:
    """Whether `value` differs from `wanted` by at most a share of it, or by `least`, whichever is
    more.
    """
    return abs(value - wanted) <= max(share * abs(wanted), least)


def steps(old: Programmed, new: Programmed) -> list[tuple[str, float]]:
    """Return the fields to set from `old` to `new`: a falling amplitude goes before all else, a
    rising one after.

    So no step is above the larger of both peaks, nor conflicts with the instrument's limit on their
    sum.
    """
    changed = [("offset_v", new.offset_v)] if new.offset_v != old.offset_v else []
    if new.frequency_hz != old.frequency_hz and new.shape is not Shape.DC:
        changed.append(("frequency_hz", new.frequency_hz))
    if new.amplitude_vpp != old.amplitude_vpp:
        falling = new.amplitude_vpp < old.amplitude_vpp
        changed.insert(0 if falling else len(changed), ("amplitude_vpp", new.amplitude_vpp))
    return changed
