"""What a solved model is good for: calibration, uncertainty and sensitivity, spectra of force and
current.
"""

__all__ = ["calibration", "sensitivity", "spectra", "uncertainty", "voltage_law"]
