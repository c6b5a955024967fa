"""Numbers as people read them: three digits and an engineering prefix before the unit."""

from __future__ import annotations

from math import floor, isfinite, log10

PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}


def readable(value: float, unit: str) -> str:
    """Such as `38.4 µA rms`, of a value in that unit; beyond pico and giga with a power of ten."""
    if not isfinite(value) or value == 0.0:
        return f"{value:g} {unit}"
    rounded = float(f"{value:.3g}")  # 999.9 mV is 1 V
    exponent = min(max(3 * floor(log10(abs(rounded)) / 3.0), min(PREFIXES)), max(PREFIXES))
    return f"{rounded / 10.0**exponent:.3g} {PREFIXES[exponent]}{unit}"
