"""Figures 4 to 8 of AliAbbasi et al. 2022 from the model: numbers, the facts that its text states,
pictures.
"""

__all__ = ["figure3", "reproduce"]
