"""A rig: its file, its devices, what they are told and what may be believed of them."""
