"""Blind tests of the diagnosis: data with hidden effects, made by code that shares nothing with the
model.
"""
