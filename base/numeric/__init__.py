"""Filters on the circle, harmonics, and robust statistics."""
