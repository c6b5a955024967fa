"""The pictures of the laboratory's commands."""

__all__ = ["contact", "from_image", "model", "psychometric", "trials"]
