"""The daemon keeps a rig ready and renders for its clients, from start-up to shutdown.

Control owns the devices and answers the API. The render process computes one command per tick. The
recorder writes samples to disk, and the observer compares measured friction with the model. They
exchange samples and settings over shared memory (`haptic_driver.processes`).

In go requests of clients, finger positions and forces. Out go commands to the generator, samples
and events. `verbs.py` lists all requests, and `state_machine.py` says which of them each state
permits.

Two rules hold. Any failure takes the output to zero first, and is a fault that somebody has to
reset. Only the holder of the lease may ask for output, and output ends with the lease.
"""

__all__ = [
    "address",
    "messages",
    "private_file",
    "quiet_log",
    "run",
    "scene",
    "set_up",
    "stepped",
    "verbs",
    "web",
]
