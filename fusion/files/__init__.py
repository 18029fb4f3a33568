"""Comparisons, masks and tables on disk."""
