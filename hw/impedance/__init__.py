"""LCR meters and impedance analysers, which drive the electrode themselves."""

__all__ = ["e4980a"]
