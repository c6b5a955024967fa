"""Instruments that speak the real dialogue as bytes, and the finger behind them."""
