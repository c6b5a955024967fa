"""Psychophysics presents stimuli to people, records their answers and estimates thresholds.

In goes the file of an experiment (`description.py`); out come one row per trial, and thresholds
with intervals. A method suggests the next level from the answers alone, so that an experiment can
go on after a crash. A trial counts as delivered only if measured friction met the request.
"""

__all__ = [
    "analysis",
    "answers",
    "apparatus",
    "data",
    "description",
    "fit",
    "functions",
    "rehearsal",
    "run",
    "schedule",
]
