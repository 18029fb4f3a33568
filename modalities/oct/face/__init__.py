"""The capillary's faces in single B-scans."""
