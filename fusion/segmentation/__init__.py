"""Cells of one side."""
