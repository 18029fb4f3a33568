"""What a specimen is drawn from: parameters, presets, ranges, random numbers."""
