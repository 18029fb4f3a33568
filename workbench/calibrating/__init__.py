"""Calibration of an instrument by a printed tube, and the tube to print."""
