"""Experiments with people: what is presented, asked and kept, and what the answers say of
thresholds.
"""
