"""The SCPI that Agilent and Keysight generators have in common: driver, last gate, simulator."""
