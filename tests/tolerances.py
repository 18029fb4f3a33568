"""The tolerances of all tests, in one place, each with where it comes from."""

# Rounding of float64 coordinate arithmetic (grids, angles).
COORDINATE_ATOL = 1e-9

# Rounding of float32 images after a filter with a kernel that sums to one.
IMAGE_ATOL = 1e-5

# What an alignment must reach: 0.05 mm along the bore, 1° around it.
ALIGNMENT_Z_MM = 0.05
ALIGNMENT_THETA_RAD = 0.0175

# The endoscope, against the simulator's truth: the annulus in pixels, and every frame's place up to a common shift.
ANNULUS_PX = 1.0
FRAME_Z_MM = 0.03
FRAME_ROLL_RAD = 0.0052  # 0.3°

# Feed and roll of strips cut from a known texture: the residue of linear interpolation between samples.
FEED_ATOL_MM = 0.002
ROLL_ATOL_RAD = 0.001

# A circle through hundreds of edge points of a noisy drawing, in pixels; half of it is the unknown gamma of cameras.
RING_PX = 0.25

# Where an OCT's point spread peaks: half the step of 1/16 pixel at which it is sampled, and rounding in float32.
POINT_SPREAD_PX = 0.05

# Mean of some 200 000 exponential intensities with neighbours tied by the window: 4.34 dB/√100 000, times five.
LEVEL_DB = 0.1

# Correlation of speckle fields over some 8 000 independent grains: three times 1/√8 000.
SPECKLE_GRAIN = 0.035

# Raw spectra resampled against the B-scan, rms over samples 22 dB over the noise: 0.5 dB, most of it noise.
RAW_SPECTRA_DB = 0.8

# Where a pixel of the simulated endoscope sees the wall, and the centres of its rings: what the project asks for.
RAY_MM = 1e-3

# Labels: a pixel and the A-scan that sees the same place, mm; that A-scan and slice found back from the pixel; the
# row at which bone begins; the documented chain with linear interpolation, rms over bright samples of the upper half.
SAME_PLACE_MM = 0.06
SAME_ASCAN = 3.0
SAME_SLICE = 0.2
SURFACE_PX = 1
CHAIN_DB = 2.0
