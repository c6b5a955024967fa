"""Simulated instruments with a finger behind them, served to the real drivers."""
