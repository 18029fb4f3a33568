"""Catheter OCT: pullbacks of B-scans, unrolled into intensity and depth of the bore wall."""
