"""What `import haptic_driver as hd` offers: one file for each of the things that people do.

`predictions` ask the model, `surfaces` look up operating points, `rigs` slide a simulated finger,
`connection` talks to a running daemon, `findings` read data and find what is missing. They are a
thin face: each calls what the commands call. Nothing else in the project imports them.
"""
