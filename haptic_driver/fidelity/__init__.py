"""One measure of fidelity: felt against asked friction, and what a finger feels of it."""
