"""The CT of a simulated bone."""
