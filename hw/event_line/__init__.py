"""Voltage edges to and from EEG amplifiers, motion capture and cameras."""
