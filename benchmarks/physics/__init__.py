"""Measures rendered recordings and holds them against theory, against what the truth says and against real ones."""
