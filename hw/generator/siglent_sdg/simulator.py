"""A simulated Siglent SDG, channel 1: one setting or several per line, no word about what it clips
or ignores.

The form of its answers follows Siglent's programming guide (PG02), and what public clients of
SDG2042X and T3AFG expect. Levels are echoed in six digits, as users of an SDG2042X found. `*RST`
switches Sync off. Its ranges are assumed.
"""

from __future__ import annotations

import math
import re
import threading
from dataclasses import replace
from typing import Any

from hw.generator.contract import GeneratorLatency, Listener, TerminalOutput
from hw.generator.terminals import Signal, Terminals, simulated_serial_number

_IDENTITY = "Siglent Technologies,SDG1032X,{serial_number},1.01.01.33R1B6"
_EMF_LOW_VPP, _EMF_PEAK_V = 0.004, 10.0
_FREQUENCY_HZ = (1e-6, 30e6)
_LOAD_OHM = (50.0, 100e3)
_SOURCE_OHM = 50.0
_RESET = Signal("SINE", 1e3, 4.0)  # 4 Vpp into an open circuit, which is what is programmed
_COMMAND = re.compile(r"C1:(?P<header>[A-Z]+)(?P<query>\?)?(?: (?P<arguments>.*))?")
_LONG = {"OUTPUT": "OUTP", "BASICWAVE": "BSWV", "MODULATEWAVE": "MDWV"}
_VALUE = re.compile(r"(?P<number>[+-]?(\d+\.?\d*|\.\d+)([E][+-]?\d+)?)(HZ|VPP|V|S)?")


class SimulatedSdg:
    """Channel 1 as bytes in, bytes out, with its own clock; see `Terminals` for the arguments.
    Thread-safe.
    """

    def __init__(
        self,
        latency: GeneratorLatency | None = None,
        *,
        listener: Listener | None = None,
        am_full_scale: float = 1.0,
    ) -> None:
        self._lock = threading.RLock()
        self._identity = _IDENTITY.format(serial_number=simulated_serial_number())
        self._signal = _RESET
        self._load_ohm = math.inf
        self._inverted = self._sync = False
        self._terminals = Terminals(
            _RESET,
            latency or GeneratorLatency(),
            _EMF_PEAK_V,
            listener=listener,
            am_full_scale=am_full_scale,
        )

    def handle(self, data: bytes) -> bytes:
        """Carry out lines and return the answers of those that ask."""
        with self._lock:
            answers = [
                self._line(line.strip().upper()) for line in data.decode("latin-1").split("\n")
            ]
        return "".join(f"{answer}\n" for answer in answers if answer is not None).encode("latin-1")

    def advance(self, dt_s: float) -> None:
        """Let simulated time pass."""
        with self._lock:
            self._terminals.advance(dt_s)

    def output(self) -> TerminalOutput:
        """What is at the open terminals now."""
        with self._lock:
            return self._terminals.output()

    @property
    def sync_on(self) -> bool:
        """Whether the Sync output at the back shows the sine's rise."""
        with self._lock:
            return self._sync

    def set_modulation_input(self, voltage_v: float) -> None:
        """Put a voltage on the rear panel's modulation input."""
        with self._lock:
            self._terminals.set_modulation_input(voltage_v)

    def _line(self, line: str) -> str | None:
        if line in ("*IDN?", "*OPC?", "SYST:ERR?"):
            return {"*IDN?": self._identity, "*OPC?": "1"}.get(line, '0,"No error"')
        if line == "*RST":
            self._signal, self._load_ohm = _RESET, math.inf
            self._inverted = self._sync = False
        match = _COMMAND.fullmatch(line)
        answer = None
        if match is not None:
            header = _LONG.get(match["header"], match["header"])
            if match["query"]:
                answer = self._ask(header)
            else:
                self._set(header, (match["arguments"] or "").split(","))
        self._terminals.put(self._signal)
        return answer

    def _ask(self, header: str) -> str | None:
        signal, scale = self._signal, self._scale
        if header == "OUTP":
            load = "HZ" if math.isinf(self._load_ohm) else f"{self._load_ohm:.0f}"
            polarity = "INVT" if self._inverted else "NOR"
            return f"C1:OUTP {'ON' if signal.on else 'OFF'},LOAD,{load},PLRT,{polarity}"
        if header == "SYNC":
            return f"C1:SYNC {'ON,TYPE,CH1' if self._sync else 'OFF'}"
        if header == "MDWV":
            return (
                "C1:MDWV AM,STATE,ON,MDSP,SINE,SRC,EXT" if signal.modulated else "C1:MDWV STATE,OFF"
            )
        if header != "BSWV":
            return None
        vpp, offset_v = signal.emf_vpp * scale, signal.emf_offset_v * scale
        if signal.function == "DC":
            return f"C1:BSWV WVTP,DC,OFST,{offset_v:.6g}V"
        return (
            f"C1:BSWV WVTP,{signal.function},FRQ,{signal.frequency_hz:.10g}HZ,"
            f"PERI,{1.0 / signal.frequency_hz:.10g}S,"
            f"AMP,{vpp:.6g}V,AMPVRMS,{vpp / math.sqrt(8.0):.4g}Vrms,OFST,{offset_v:.6g}V,"
            f"HLEV,{offset_v + 0.5 * vpp:.6g}V,LLEV,{offset_v - 0.5 * vpp:.6g}V,PHSE,0"
        )

    @property
    def _scale(self) -> float:
        return (
            1.0 if math.isinf(self._load_ohm) else self._load_ohm / (self._load_ohm + _SOURCE_OHM)
        )

    def _set(self, header: str, arguments: list[str]) -> None:
        if header == "OUTP":
            if arguments[0] in ("ON", "OFF"):
                self._change(on=arguments.pop(0) == "ON")
            for key, value in zip(arguments[::2], arguments[1::2], strict=False):
                if key == "LOAD":
                    self._set_load(value)
                if key == "PLRT" and value in ("NOR", "INVT"):
                    self._inverted = value == "INVT"
        elif header == "SYNC":
            self._sync = arguments[0] == "ON"
        elif header == "MDWV":
            for key, value in zip(arguments[::2], arguments[1::2], strict=False):
                if key == "STATE" and value in ("ON", "OFF"):
                    self._change(modulated=value == "ON")
        elif header == "BSWV":
            for key, value in zip(arguments[::2], arguments[1::2], strict=False):
                self._set_wave(key, value)

    def _set_load(self, text: str) -> None:
        if text == "HZ":
            self._load_ohm = math.inf
        elif (load_ohm := _number(text)) is not None:
            self._load_ohm = float(int(min(max(load_ohm, _LOAD_OHM[0]), _LOAD_OHM[1])))

    def _set_wave(self, key: str, text: str) -> None:
        """What has no meaning is ignored, what is too much is clipped; an amplitude wins over the
        offset.
        """
        if key == "WVTP":
            if text in ("SINE", "SQUARE", "RAMP", "PULSE", "DC"):
                self._change(function=text, silent=text == "DC")
            return
        value = _number(text)
        if value is None:
            return
        if key == "FRQ":
            self._change(frequency_hz=min(max(value, _FREQUENCY_HZ[0]), _FREQUENCY_HZ[1]))
        elif key == "AMP":
            self._change(emf_vpp=min(max(value / self._scale, _EMF_LOW_VPP), 2.0 * _EMF_PEAK_V))
        elif key == "OFST":
            self._change(emf_offset_v=value / self._scale)
        room_v = _EMF_PEAK_V - (0.0 if self._signal.silent else 0.5 * self._signal.emf_vpp)
        self._change(emf_offset_v=min(max(self._signal.emf_offset_v, -room_v), room_v))

    def _change(self, **values: Any) -> None:
        self._signal = replace(self._signal, **values)


def _number(text: str) -> float | None:
    """A number with or without its unit; None for what is neither."""
    match = _VALUE.fullmatch(text)
    return None if match is None or math.isinf(float(match["number"])) else float(match["number"])
