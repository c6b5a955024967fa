"""What simulated instruments stand on: sockets, pseudo-terminals, framing."""
