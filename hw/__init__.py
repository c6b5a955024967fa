"""The devices of the rig, each with its driver and its simulator.

A room holds one type of device: a contract, which the driver package relies on, and one module or
room per instrument. In go SI values, out go bytes of the instrument's protocol, and readings come
back in SI values.

Two rules hold. Nothing here imports the model or the driver package. A driver imports no simulator,
and a simulator speaks the instrument's own bytes.
"""
