"""The tolerances of all tests, in one place, each with where it comes from."""

# Rounding of float64 coordinate arithmetic (grids, angles).
COORDINATE_ATOL = 1e-9

# Rounding of float32 images after a filter with a kernel that sums to one.
IMAGE_ATOL = 1e-5

# What an alignment must reach: 0.05 mm along the bore, 1° around it.
ALIGNMENT_Z_MM = 0.05
ALIGNMENT_THETA_RAD = 0.0175
