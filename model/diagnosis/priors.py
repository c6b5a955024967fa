"""The numbers of the diagnosis that a person sets; docs/verdict.md gives the reason for each."""

from __future__ import annotations

from math import log

from model.effects import CATALOGUE

NONE, UNKNOWN = "none", "unknown"  # hypotheses without a name of the catalogue
PRIOR_NONE, PRIOR_UNKNOWN = 0.3, 0.14
PRIOR_EFFECTS = 1.0 - PRIOR_NONE - PRIOR_UNKNOWN  # shared by all of the catalogue

# Of an effect whose formula is not quite a device's: the probability that it is, and what its form
# is off otherwise, as a share of its signature (each witness apart) or of its strength (together).
EXACT = 0.25
FORM_ERRORS = (0.025, 0.05, 0.1), (0.05, 0.1, 0.2)
# Of a discrepancy of unknown shape: standard deviation of log friction, of log amounts, or rad.
# Of a force sensor that reads the load: share of it, and as much of LOAD_REFERENCE_N for its zero.
AMPLITUDES = (0.005, 0.012, 0.03, 0.08, 0.2)

SURE = 0.95  # the probability that a name, or a list of names, must have

LOG_ODDS = log(SURE / (1.0 - SURE))  # of what is SURE against what is not
LOG_PRIOR_EACH = log(PRIOR_EFFECTS / len(CATALOGUE))


def words(name: str) -> str:
    """A hypothesis as people say it."""
    if name in (NONE, UNKNOWN):
        return {NONE: "nothing missing", UNKNOWN: "unknown effect"}[name]
    return name.replace("_", " ").replace("+", " with ")
