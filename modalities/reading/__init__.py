"""Recordings as they lie on the disk: images, TIFF, arrays and videos."""
