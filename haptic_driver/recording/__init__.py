"""Runs of the daemon on disk: written while they go on, read and exported later."""
