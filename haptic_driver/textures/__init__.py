"""Texture files -> textures that the render stage can evaluate."""
