"""What the controller looks up: a model solved over frequency, voltage and load, and its file."""
