"""The pictures of the laboratory's commands."""
