"""Contact mechanics gives the gaps between rough skin and a flat screen under pressure.

In go a pressure and a roughness: Hurst exponent, cut-offs, height and elastic modulus. Out come the
real contact area and the distribution of gaps, by Persson's theory (`gap_distribution.py`). The
electrical side needs two integrals over that distribution. `gap_table.py` tabulates them once per
roughness shape, in dimensionless units, so one table serves all fingers of that shape.

Outside the table its limits hold, and `theory_error.py` states how far the theory is from a
boundary-element solution.
"""

__all__ = [
    "gap_distribution",
    "gap_integrals",
    "gap_table",
    "resolution",
    "roughness",
    "theory_error",
]
