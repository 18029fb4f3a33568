"""Labels for training networks, in addition to the truth: of every A-scan, every pixel and every cell."""
