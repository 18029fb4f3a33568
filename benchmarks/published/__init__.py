"""Specimens of the second generator for published benchmarks, in the layout of simulated ones, and whole sets."""
