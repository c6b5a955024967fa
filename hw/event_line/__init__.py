"""Voltage edges to and from EEG amplifiers, motion capture and cameras."""

__all__ = ["contract", "modem_line", "parallel_port", "simulated", "trigger_box"]
