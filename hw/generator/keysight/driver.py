"""Agilent's and Keysight's generators: SCPI in one line per set point, read back with the error
queue.
"""

from __future__ import annotations

from abc import ABC
from collections.abc import Sequence

from hw.errors import BadReply, InstrumentRejected
from hw.generator.dialogue import NOT_WHOLE, ScpiDialogue
from hw.generator.driver import GeneratorDriver, Programmed, near, steps
from hw.generator.keysight.gate import KeysightGate
from hw.generator.settings import GeneratorSettings, RangePolicy, Shape
from hw.setting import Setting
from hw.transport.contract import Transport

# A value read back may differ by this share, or by the last of four digits at the low end (0.1 mV).
_LEVEL_TOLERANCE = 1e-3
_LEVEL_LSB_V = 1e-4
_FREQUENCY_TOLERANCE = 1e-6
# OUTP:LOAD? answers 9.9e37 for INF; any finite load is at most 10 kohm.
_LOAD_INF_OHM = 9.9e37

# All that decides the peak at an open terminal, asked at each set point: somebody at the front
# panel, or a power cycle behind an interface that stays up, can bring LOAD 50 back; then VOLT?
# alone looks right at twice the voltage.
_STATE_QUERIES = (
    "FUNC?",
    "FREQ?",
    "VOLT?",
    "VOLT:OFFS?",
    "VOLT:UNIT?",
    "OUTP:LOAD?",
    "AM:STAT?",
    "OUTP:POL?",
    "BURS:STAT?",
)
_LIMIT_QUERIES = ("VOLT:LIM:HIGH?", "VOLT:LIM:LOW?", "VOLT:LIM:STAT?")
_FUNCTIONS = {Shape.SINE: "SIN", Shape.SQUARE: "SQU", Shape.DC: "DC"}
_HEADERS = {"offset_v": "VOLT:OFFS", "frequency_hz": "FREQ", "amplitude_vpp": "VOLT"}
_MODULATE = {"AM:SOUR": "EXT", "AM:DEPT": "100", "AM:STAT": "1"}
_MODULATION_QUERIES = ("AM:SOUR?", "AM:DEPT?")
# Sync triggers what measures phases; an inverted output is half a turn away from it.
_SYNC = {"OUTP:POL": "NORM", "OUTP:SYNC": "1"}
_HELD = {"OUTP:LOAD": "INF", "VOLT:UNIT": "VPP", "FUNC": "SIN", "AM:STAT": "0", "BURS:STAT": "0"}


class KeysightGenerator(GeneratorDriver, ABC):
    """What the 33220A and the 33500s have in common.

    Each line sets a value, reads it back and asks for the instrument's errors, so a set point costs
    one round trip. A value that the instrument clipped or moved is an error. `APPLy` is never sent:
    it turns the output on. A generator that was switched off and on comes back with LOAD 50, which
    would double the voltage: it is asked each time. With `limits_itself` the instrument's VOLT:LIM
    is set to the rig's limit, and asked each time too.
    """

    shapes = frozenset(Shape)
    external_modulation = True

    def __init__(self, transport: Transport, settings: GeneratorSettings) -> None:
        self._line = ScpiDialogue(transport, KeysightGate(settings), settings.reply_timeout_s)
        super().__init__(self._line, settings)

    def _ask_state(self) -> tuple[bool, bool, str]:
        queries = ("OUTP?", "OUTP:LOAD?", "FUNC?", "VOLT?", "VOLT:OFFS?", "VOLT:UNIT?")
        output, load, function, level, offset, unit = (
            self._line.ask([query], 1)[0] for query in queries
        )
        number = self._line.number
        programmed = f"{function}, {number(level):g} {unit}, offset {number(offset):g} V"
        return self._line.boolean(output), number(load) >= _LOAD_INF_OHM, programmed

    def _ask_held(self) -> list[Setting]:
        wanted = {**_HELD, **_SYNC}
        fixed = self.settings.range_policy is RangePolicy.FIXED
        wanted["VOLT:RANG:AUTO"] = "0" if fixed else "1"
        if self.limits_itself:
            wanted["VOLT:LIM:STAT"] = "1"
        answers = {header: self._line.ask([f"{header}?"], 1)[0] for header in wanted}
        load_ohm = self._line.number(answers["OUTP:LOAD"])
        answers["OUTP:LOAD"] = "INF" if load_ohm >= _LOAD_INF_OHM else f"{load_ohm:g}"
        return [Setting(header, value, answers[header]) for header, value in wanted.items()]

    def _reset(self) -> None:
        (output,) = self._line.ask(["OUTP 0", "*RST", "*CLS", "OUTP?"], 1)
        self._check_output(self._line.boolean(output), on=False)

    def _set_up(self) -> None:
        fixed = self.settings.range_policy is RangePolicy.FIXED
        base = self._base()
        commands = [
            "VOLT MIN",
            "VOLT:OFFS 0",
            "AM:STAT 0",
            "BURS:STAT 0",
            "OUTP:LOAD INF",
            "VOLT:UNIT VPP",
            "FUNC SIN",
        ]
        commands += ["VOLT MIN", "VOLT:OFFS 0", f"FREQ {base.frequency_hz:.12g}"]
        commands += [f"{header} {value}" for header, value in _SYNC.items()]
        if self.limits_itself:
            limit_v = self._own_limit_v()
            commands += [
                f"VOLT:LIM:HIGH {limit_v:.12g}",
                f"VOLT:LIM:LOW {-limit_v:.12g}",
                "VOLT:LIM:STAT 1",
            ]
        commands += [] if fixed else ["VOLT:RANG:AUTO ON"]
        autorange, output, sync, *state = self._line.command(
            commands, ["VOLT:RANG:AUTO?", "OUTP?", "OUTP:SYNC?", *self._queries(base)]
        )
        self._check_state(state, base)
        self._check_answers({"OUTP:SYNC?": sync}, {"OUTP:SYNC?": _SYNC["OUTP:SYNC"]})
        if fixed and self._line.boolean(autorange):
            self._fix_range(output)

    def _fix_range(self, output: str) -> None:
        """Visit the highest amplitude with the output off, since a range is kept as it is when
        ranging ends.
        """
        if self._line.boolean(output):
            self.off()
            raise self._line.bad_reply(
                "is on and changes its range by itself", "somebody used it; connect again"
            )
        high_vpp = min(
            max(2.0 * self._own_limit_v(), self.amplitude_low_vpp), self.amplitude_high_vpp
        )
        base = self._base()
        autorange, output, *state = self._line.command(
            ["OUTP 0", f"VOLT {high_vpp:.12g}", "VOLT:RANG:AUTO OFF", "VOLT MIN"],
            ["VOLT:RANG:AUTO?", "OUTP?", *self._queries(base)],
        )
        self._check_answers({"VOLT:RANG:AUTO?": autorange}, {"VOLT:RANG:AUTO?": "0"})
        self._check_output(self._line.boolean(output), on=False)
        self._check_state(state, base)

    def _own_limit_v(self) -> float:
        """The rig's limit at the generator's terminals."""
        return min(
            self.settings.voltage_limit_v / self.settings.volts_per_volt,
            0.5 * self.amplitude_high_vpp,
        )

    def _change_waveform(self, wanted: Programmed) -> None:
        base = self._base()
        commands = ["OUTP 0", "VOLT MIN", "VOLT:OFFS 0", "AM:STAT 0", "BURS:STAT 0", "FUNC SIN"]
        commands += ["VOLT MIN", "VOLT:OFFS 0", f"FREQ {base.frequency_hz:.12g}"]
        output, *state = self._line.command(commands, ["OUTP?", *self._queries(base)])
        self._check_output(self._line.boolean(output), on=False)
        self._check_state(state, base)
        if wanted.shape is not Shape.SINE:
            self._set_and_check({"FUNC": _FUNCTIONS[wanted.shape]})
        if wanted.modulation is not None:
            self._set_and_check(_MODULATE)

    def _program(self, believed: Programmed, wanted: Programmed) -> None:
        try:
            commands = [f"{_HEADERS[name]} {value:.12g}" for name, value in steps(believed, wanted)]
            state = self._line.command(commands, self._queries(wanted))
        except InstrumentRejected:
            self.off()
            raise
        self._check_state(state, wanted)

    def _ask_output(self) -> bool:
        return self._line.boolean(self._line.ask(["OUTP?"], 1)[0])

    def _switch(self, on: bool) -> bool:
        (output,) = self._line.command([f"OUTP {on:d}"], ["OUTP?"])
        return self._line.boolean(output)

    def _try_off(self, *, levels: bool) -> bool:
        lowered = ["VOLT MIN", "VOLT:OFFS 0"] if levels else []
        return self._line.boolean(self._line.ask([*lowered, "OUTP 0", "OUTP?"], 1)[0])

    # --- what is read back

    def _queries(self, programmed: Programmed) -> list[str]:
        """What to ask at each set point; a constant voltage has no frequency."""
        asked = [
            query
            for query in _STATE_QUERIES
            if query != "FREQ?" or programmed.shape is not Shape.DC
        ]
        asked += _MODULATION_QUERIES if programmed.modulation is not None else ()
        return [*asked, *(_LIMIT_QUERIES if self.limits_itself else ())]

    def _check_state(self, answers: Sequence[str], wanted: Programmed) -> None:
        """Compare answers to `_queries`; what is not as set may be any voltage, so it is switched
        off.
        """
        shown = dict(zip(self._queries(wanted), answers, strict=True))
        number = self._line.number
        try:
            as_set = (
                shown["FUNC?"] == _FUNCTIONS[wanted.shape]
                and (
                    "FREQ?" not in shown
                    or near(number(shown["FREQ?"]), wanted.frequency_hz, _FREQUENCY_TOLERANCE)
                )
                and near(
                    number(shown["VOLT?"]), wanted.amplitude_vpp, _LEVEL_TOLERANCE, _LEVEL_LSB_V
                )
                and near(
                    number(shown["VOLT:OFFS?"]), wanted.offset_v, _LEVEL_TOLERANCE, _LEVEL_LSB_V
                )
                and shown["VOLT:UNIT?"] == "VPP"
                and number(shown["OUTP:LOAD?"]) >= _LOAD_INF_OHM
                and shown["OUTP:POL?"] == _SYNC["OUTP:POL"]
                and self._line.boolean(shown["AM:STAT?"]) is (wanted.modulation is not None)
                and not self._line.boolean(shown["BURS:STAT?"])
                and all(
                    self._says(shown[query], _MODULATE[query[:-1]])
                    for query in _MODULATION_QUERIES
                    if query in shown
                )
                and self._limited(shown)
            )
        except BadReply:
            as_set = False
        if not as_set:
            self.off()
            raise self._line.bad_reply(
                f"holds {', '.join(f'{query} {answer}' for query, answer in shown.items())} where"
                f" {_FUNCTIONS[wanted.shape]}, {wanted.frequency_hz:g} Hz, {wanted.amplitude_vpp:g}"
                f" VPP, offset {wanted.offset_v:g} V and an open load were set",
                NOT_WHOLE,
            )

    def _limited(self, shown: dict[str, str]) -> bool:
        """Whether the instrument's own limit stands where it was set."""
        if not self.limits_itself:
            return True
        high, low, state = (shown[query] for query in _LIMIT_QUERIES)
        limit_v = self._own_limit_v()
        levels = ((self._line.number(high), limit_v), (self._line.number(low), -limit_v))
        return self._line.boolean(state) and all(
            near(v, w, _LEVEL_TOLERANCE, _LEVEL_LSB_V) for v, w in levels
        )

    def _set_and_check(self, settings: dict[str, str]) -> None:
        """Set each header to its value, in this order, and read all of them back."""
        queries = [f"{header}?" for header in settings]
        answers = self._line.command(
            [f"{header} {value}" for header, value in settings.items()], queries
        )
        self._check_answers(
            dict(zip(queries, answers, strict=True)),
            dict(zip(queries, settings.values(), strict=True)),
        )

    def _check_answers(self, shown: dict[str, str], wanted: dict[str, str]) -> None:
        """Compare answers with what was set; what is not as set is switched off."""
        for query, value in wanted.items():
            if not self._says(shown[query], value):
                self.off()
                raise self._line.bad_reply(
                    f"answers {shown[query]} to {query} where {value} was set", NOT_WHOLE
                )

    def _says(self, answer: str, value: str) -> bool:
        """Words are compared by themselves and numbers by value."""
        if answer == value or not value[:1].isdigit():
            return answer == value
        try:
            return near(self._line.number(answer), float(value), _LEVEL_TOLERANCE)
        except BadReply:
            return False
