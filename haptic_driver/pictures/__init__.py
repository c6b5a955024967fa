"""Every picture that a command or the page shows."""

__all__ = ["friction_pictures", "saving", "textures"]
