"""What a diagnosis says to people and programs: the report, its page and pictures, the corrected
model.
"""

__all__ = ["model_file", "page", "pictures", "report"]
