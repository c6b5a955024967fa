"""Papers that a laboratory hands in: what stands on them, and how they are laid out."""

__all__ = [
    "data_sheet",
    "participants",
    "safety",
    "safety_facts",
    "sheet_passes",
    "sheet_person",
    "write",
]
