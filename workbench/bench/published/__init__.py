"""Published benchmarks: frozen sets of specimens with truth, submissions on them, and the board of all submissions."""
