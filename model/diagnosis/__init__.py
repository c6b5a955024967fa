"""The diagnosis finds where data and model disagree, and which effect is missing from the model.

In go a model and a table of measured data. Out comes a verdict: nothing is missing, one or two
named effects, something unknown, or too little data. Probabilities and a proof come with it. The
stages are audit, fit, evidence, posterior, proof and decision (`workflow.py`).

Each hypothesis is the model plus effects of the catalogue. Beside these stands a smooth discrepancy
of unknown shape, so the catalogue need not hold the true effect.

Two rules hold. An effect is named only if it also predicts data that no fit has seen. The numbers
that a person sets stand in `priors.py` with their reasons.
"""

__all__ = [
    "changed",
    "data",
    "ends",
    "hidden",
    "hypotheses",
    "learned",
    "model_fit",
    "noise",
    "priors",
    "proof",
    "readings",
    "smooth",
    "space",
    "where",
    "witness",
    "workflow",
]
