"""What simulated instruments stand on: sockets, pseudo-terminals, framing."""

__all__ = ["memory", "responder", "serial", "tcp"]
