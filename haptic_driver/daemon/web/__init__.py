"""The web server carries the daemon's API and its page, over a local socket and optionally loopback
TCP.

`door.py` accepts connections in a thread of its own and handles OFF itself, so OFF works while the
server hangs.
"""
