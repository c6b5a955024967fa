"""What a solved model is good for: calibration, uncertainty and sensitivity, spectra of force and
current.
"""
