"""Comparisons with independent solvers: `make validate`. Needs the extra `validate`; nothing
shipped imports it.
"""
