"""The tolerances of all tests, in one place, each with where it comes from."""

# Rounding of float64 coordinate arithmetic (grids, angles).
COORDINATE_ATOL = 1e-9

# Rounding of float32 images after a filter with a kernel that sums to one.
IMAGE_ATOL = 1e-5
