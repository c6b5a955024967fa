"""What the processes of the daemon share: starting one, keeping its time, and the memory between
them.
"""
