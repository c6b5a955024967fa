"""What was measured or recorded elsewhere becomes friction over position, or a texture."""
