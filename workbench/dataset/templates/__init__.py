"""Texts of data sets: README, licence, and where the arrays of each format lie."""
