"""The bore's wall behind the capillary, in single B-scans."""
