"""The Keysight 33500B and 33600A: driver and simulator."""
