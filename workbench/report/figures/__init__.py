"""The figures of a comparison, drawn with matplotlib and NumPy alone."""
