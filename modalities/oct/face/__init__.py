"""The capillary in single B-scans: bright lines, which of them is its outer face, and its glass."""
