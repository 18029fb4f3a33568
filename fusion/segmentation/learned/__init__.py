"""A learned eye: a small network that says of each sample how probably it is a cell."""
