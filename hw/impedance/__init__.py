"""LCR meters and impedance analysers, which drive the electrode themselves."""
