"""A made-up generator, as a package of its own: driver, last gate, simulator, and the kind that an
entry point names.

It takes a letter and a number per line: `F250` (Hz), `A2.4` (Vpp, open circuit), `O0` (offset, V),
`G1` (output on). `?` is answered by `LAB F250 A2.4 O0 G1`.
"""

import os
import re
import threading
from dataclasses import replace

from hw.generator.contract import GeneratorKind
from hw.generator.dialogue import GeneratorDialogue
from hw.generator.driver import GeneratorDriver, near, steps
from hw.generator.gate import Bound, OutputGate
from hw.generator.terminals import Signal, Terminals

ANSWER = re.compile(r"LAB F(\S+) A(\S+) O(\S+) G([01])")
LETTERS = {"frequency_hz": "F", "amplitude_vpp": "A", "offset_v": "O"}


class LabGate(OutputGate):
    """Reads what is about to be sent, and refuses what it does not know. Levels always mean an open
    circuit here.
    """

    speaker = "LabGenerator"

    def _after(self, bound: Bound, message: str) -> Bound:
        bound = replace(bound, share=0.5, modulated=False, load_open=True, unit_vpp=True)
        command = message.removesuffix("\n")
        if command in ("*IDN?", "?", "G0") or command.startswith("F"):
            return bound
        if command == "A0.02":  # the least: always allowed
            return replace(bound, vpp=0.02)
        if command == "O0":
            return replace(bound, offset_v=0.0)
        if command == "G1":
            return self._checked(bound, command)
        if command.startswith("A"):
            return self._checked(
                replace(bound, vpp=self._level(bound, command[1:], command)), command
            )
        if command.startswith("O"):
            return self._checked(
                replace(bound, offset_v=self._level(bound, command[1:], command)), command
            )
        raise self._refusal(command)


class LabGenerator(GeneratorDriver):
    """What the base class cannot know: the words. Limits, belief and the way off are there
    already.
    """

    model = re.compile("LAB1")  # the second field of the answer to *IDN?
    amplitude_low_vpp = 0.02
    amplitude_high_vpp = 20.0

    def __init__(self, transport, settings):
        self._line = GeneratorDialogue(transport, LabGate(settings), settings.reply_timeout_s)
        super().__init__(self._line, settings)

    def _ask(self):
        match = ANSWER.fullmatch(self._line.query("?"))
        if match is None:
            raise self._line.bad_reply("does not say its state", "look at the instrument")
        return [self._line.number(text) for text in match.groups()]

    def _ask_state(self):
        frequency_hz, amplitude_vpp, offset_v, output = self._ask()
        return (
            output == 1.0,
            True,
            f"{frequency_hz:g} Hz, {amplitude_vpp:g} Vpp, offset {offset_v:g} V",
        )

    def _ask_output(self):
        return self._ask()[3] == 1.0

    def _reset(self):
        self._check_output(self._try_off(levels=True), on=False)

    def _set_up(self):
        base = self._base()
        for command in ("A0.02", "O0", f"F{base.frequency_hz:.12g}"):
            self._line.send(command)
        self._program(base, base)

    def _program(self, believed, wanted):
        for name, value in steps(believed, wanted):
            self._line.send(f"{LETTERS[name]}{value:.12g}")
        shown = self._ask()[:3]
        if not all(near(*pair, 1e-6) for pair in zip(shown, wanted[2:], strict=True)):
            self.off()
            raise self._line.bad_reply(f"holds {shown}", "somebody changed it")

    def _switch(self, on):
        self._line.send(f"G{on:d}")
        return self._ask_output()

    def _try_off(self, *, levels):
        for command in ("A0.02", "O0") if levels else ():
            self._line.send(command)
        return self._switch(False)


class SimulatedLabGenerator:
    """The instrument as bytes in, bytes out; `Terminals` brings what it holds to the terminals."""

    def __init__(self, latency, *, listener=None, am_full_scale=1.0):
        self._lock = threading.RLock()
        self._signal = Signal("sine", 1000.0, 0.02)
        self._terminals = Terminals(
            self._signal, latency, 10.0, listener=listener, am_full_scale=am_full_scale
        )

    def handle(self, data):
        with self._lock:
            return b"".join(self._line(line) for line in data.decode("latin-1").split("\n"))

    def _line(self, line):
        signal = self._signal
        if line == "*IDN?":
            return f"Our lab,LAB1,{os.getpid()},1.0\n".encode()
        if line == "?":
            values = f"F{signal.frequency_hz} A{signal.emf_vpp} O{signal.emf_offset_v}"
            return f"LAB {values} G{signal.on:d}\n".encode()
        try:
            value = float(line[1:])
        except ValueError:
            return b""
        names = {"F": "frequency_hz", "A": "emf_vpp", "O": "emf_offset_v"}
        if line[0] == "G":
            self._signal = replace(signal, on=value == 1.0)
        elif line[0] in names:
            self._signal = replace(signal, **{names[line[0]]: value})
        self._terminals.put(self._signal)
        return b""

    def advance(self, dt_s):
        with self._lock:
            self._terminals.advance(dt_s)

    def output(self):
        with self._lock:
            return self._terminals.output()

    def set_modulation_input(self, voltage_v):
        with self._lock:
            self._terminals.set_modulation_input(voltage_v)


KIND = GeneratorKind(
    make=LabGenerator,
    simulator=SimulatedLabGenerator,
    amplitude_low_vpp=LabGenerator.amplitude_low_vpp,
    amplitude_high_vpp=LabGenerator.amplitude_high_vpp,
    ask_off=b"?\n",  # the watchdog's words
    switch_off=b"G0\n",
    off_answers=re.compile(rb"LAB F\S+ A\S+ O\S+ G(?:(?P<off>0)|1)"),
)
