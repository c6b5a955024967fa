"""Papers that a laboratory hands in: what stands on them, and how they are laid out."""

__all__ = [
    "data_sheet",
    "document",
    "participants",
    "safety",
    "safety_facts",
    "sheet_passes",
    "sheet_person",
]
