"""Volumes drawn at random, in every container, with and without a fault: none with one may be believed."""
