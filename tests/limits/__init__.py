"""Random models on random rigs: does anything that goes out exceed a limit, by the full model at
that very point?
"""
