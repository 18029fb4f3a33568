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

# Root mean square of 2000 normal errors over their standard errors, which err by 1/√(2·80) each: 0.016, times four.
MEDIAN_ERROR = 0.065

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

# Places of the wall located in frames as recorded, against the truth (learning preset): medians. Most of it is by how
# much the survey errs about rotation, feed and rims.
LOCATED_ASCANS = 2.5
LOCATED_DEPTH_PX = 1.0
LOCATED_PX = 2.5
# Places between those of a picture's table, interpolated.
TABLED_PX = 0.05

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

# The simulated endoscope's light against the formula: float32 through some twenty operations and a table lookup.
LIGHT_REL = 2e-4

# Variance of 200 000 normal numbers: √(2/200 000) = 0.3 %, of an offset found by a line through ten of them more.
NOISE_REL = 0.03

# A surface found by the secant rule within 4 µm, and the ray's own float64 arithmetic; the rounding of a rim not.
SURFACE_MM = 1e-4

# The same in float32, as the wall is baked.
BAKED_MM = 2e-4

# Speckle in rendered bone and noise: four slices of some 2000 × 40 pixels, of which every 25th is independent in bone.
# Five standard errors, and the rounding to counts of 0.3 dB.
SPECKLE_CONTRAST = 0.03
SPECKLE_SIGMA_DB = 0.1
SPECKLE_SKEW = 0.06

# Widths of points, edges and grains in rendered pixels against those drawn: noise of 1 %, and that a window of Hann
# times Gauss is taken for a Gauss.
POINT_SPREAD_REL = 0.035

# The level of a bright line at many depths, and bone behind 6 slices of speckle with some 150 grains each in a row.
ROLL_OFF_DB = 0.05
ATTENUATION_DB = 0.1

# How bright bone is in the OCT over how dense it is in the CT, at 500 places, each with 9 % of speckle (one σ is 2 %),
# and over what length density correlates, in a picture of 25 cm³.
DENSITY_SLOPE = 0.1
DENSITY_LENGTH_REL = 0.05

# Rings of pixels of 8 bits, out of 150, averaged: half a count of gamma 1.8.
LIGHT_OF_FRAME_REL = 0.006

# The simulated endoscope's light against traced photons: what is asked of direct light, and of floors of cells with
# the light that other bone throws on them. On the floors some 10 000 photons are counted.
DIRECT_LIGHT_REL = 0.02
ALL_LIGHT_REL = 0.10

# Skew of clipped logarithms of real speckle, whose processing is not known.
REAL_SKEW = 0.35

# Found by estimators of their own: the catheter by hundreds of points of a line that is 1.5–2.5 rows wide (a fifth of
# a row of 5 µm); the wall's row by the rise of its mean (half a row); the place of a slice or of a frame on the true
# wall by steps of 0.02 mm (a tenth of the pitch); angle by speckle as wide as the beam, 0.02 rad, at a few edges (a
# whole A-scan is 0.0123 rad); feed and roll of images of 320 × 240, in which a pixel is 0.018 mm and 0.01 rad, and
# roll on the wall by cells that a probe off the axis sees turned by up to 0.04 rad; the rim to a fifth of a pixel.
FOUND_OFFSET_MM = 0.0012
FOUND_WALL_PX = 0.4
FOUND_PLACE_MM = 0.03
FOUND_TURNING_RAD = 0.009
FOUND_FEED_MM = 0.009
FOUND_ROLL_RAD = 0.005
FOUND_ROLL_ON_WALL_RAD = 0.015
FOUND_RIM_PX = 0.25

# The same on paint, mean of eight frames of 320 × 240: a tenth of a pixel, where half of one is 0.009 mm and 0.005 rad;
# single frames scatter by 0.001 mm and 0.001 rad.
FOUND_PAINT_MM = 0.002
FOUND_PAINT_RAD = 0.003

# Cells drawn as discs of some 400 samples and more: the staircase of their edge.
CELL_AREA_REL = 0.01
CELL_PLACE_MM = 0.005

# How often an interval of 95 % covers: 300 trials scatter by 0.013; percentile bootstraps of 40 are a little narrow.
COVERAGE = 0.03

# Parts of the agreement budget against what was put in: the phase of the rows is drawn, not known, and cells touch.
BUDGET = 0.03
# The same where one cause is all there is, relative: four errors stand for a normal distribution.
BUDGET_OF_ONE_CAUSE = 0.15

# Sensitivity of raters over some 10 000 samples of cell: three standard errors, and that truth is estimated with it.
STAPLE = 0.025

# A turn's angles told by the capillary 0.25 mm off axis, 1 µm of noise in each of 256 sectors: 0.1°, times four. Starts
# told by three sheath lines 20 µm off axis: 1 µm·√(2/256)/20 µm/√3 = 0.15°, the largest of 14 three times that.
TURN_RAD = 0.007
FREE_START_RAD = 0.009
START_RAD = 0.005

# An alignment after both sides were rolled by whole samples: the search's and the light's grids do not roll with them.
ROLLED_RAD = 5e-5
ROLLED_Z_MM = 1e-4

# What is asked of fine panoramas, in px of 2048 around: the goal is 0.05 in the mean, single cases reach 0.1.
LANDMARK_PX = 0.12

ELEMENTARY = 2e-6  # of float32 logarithms and exponentials, relative or absolute, and of azimuths, rad

REFINED_RAD, REFINED_MM = 2e-5, 5e-5
"""By how much an alignment may move for where its refinement starts or how its sums are taken: a hundredth of the
error it has."""

# The independent generator. Optical paths found by a simplex search; a picture's place by its texture, 60 000 samples
# with a quarter of their contrast in noise; overlaps counted on a grid of 10 µm; cells seen by a plain threshold.
INDEPENDENT_PATH_MM = 1e-7
INDEPENDENT_PLACE_RAD = 1e-3
INDEPENDENT_PLACE_MM = 1e-3
INDEPENDENT_PLACE_SCALE = 1e-3
INDEPENDENT_LOSS = 0.02
INDEPENDENT_SEEN = 0.85
# The capillary's diameter by the course of its face: what of the circle's second harmonic goes beyond the fourth order
# of e/R, where a size of half the true one is stated. Without glass κR is not known to 5 %.
COURSE_RTOL = 0.04

# The value of a key that would agree with the wall: 0.005 mm of the phantom's gap of 0.4 mm.
AGREEING_RTOL = 0.02

# The instrument from rendered pixels: what the project asks for. Correlations over some 8000 grains: three standard
# errors of 0.011. The ghost's level: three resolved grains of phase in the face's course, 2 dB rms, over 20 A-scans.
SPECKLE_OVER_SPEED_REL = 0.05
SPEED_REL = 0.03  # of a catheter, over 50 A-scans of 12 slices: two standard errors
INSTRUMENT_REL = 0.10
SPECKLE_CORRELATION = 0.035
GHOST_DB = 1.5
# A band of polymer, whose grains are some 40 A-scans wide: 6 slices of some 50 grains in 10 rows.
SPECKLE_CONTRAST_OF_SHEATH = 0.08

# Raw spectra to B-scans. A B-scan counts in 1/256 dB, its logarithm errs by 1/80 of that, sums in float32 by as much.
COUNT_DB = 0.004
QUANTISED_DB = 0.002  # in the mean over depths
# A chirp's inverse by monotone cubics, where it bends by up to 0.4 over 128 samples.
INVERSE_CHIRP_PX = 2e-3
# A mirror's place by a parabola through three decibels of a Hann window, and its mirror image's side lobes near zero.
PEAK_PX = 0.02
# The same behind a chirp: the inverse chirp, and what cubics make of waves up to 0.7 of the highest.
CHIRPED_PEAK_PX = 0.05
# A point spread behind a chirp against the window's transform: 0.02 dB of roll-off, and the mirror image's side lobes.
POINT_SPREAD_SHARE = 5e-3
# Widths sampled at 1/32 px: two ends.
POINT_WIDTH_PX = 0.0625
# What is left of a cubic's roll-off at 0.7 of full depth, where it is made good by that of noise; and scalloping.
ROLL_OFF_LEFT_DB = 0.6
# Side lobes 58 dB down, where cubics leave as much as 5 % of them.
SIDE_LOBE_DB = 0.8
# The same spectra through the simulator's reconstruction: rounding to its counts of 0.5 dB.
REBUILT_DB = 0.27
# The wall on raw spectra against the wall on B-scans that share part of their noise: a depth sample.
SAME_WALL_MM = 0.0051

# Where a CT's header puts a voxel: what the project asks for. Headers state positions to a thousandth of that.
CT_PLACE_MM = 0.01
# Values of a sheared slice moved along itself by a cubic spline, of a pattern with waves of six voxels and more: 1 % of
# its amplitude.
CT_SHEARED_HU = 10.0

# The share of air, and its change per mm, resampled from voxels whose places differ by the rounding of float32 headers.
AIR_SAME = 1e-3

# The axis of a bore that is found, off the true target; the demonstration's is 0.016 mm off.
TARGET_OFF_MM = 0.1

# Counts of an image that another processor may round otherwise.
COUNTS_BY_ROUNDING = 1

# Where a turn ends in a stream of A-scans that repeats itself: one A-scan.
A_SCAN = 1.0
CHOSEN_FEED_MM, CHOSEN_ROLL_RAD = 0.017, 0.015
"""Feed and roll of a toy wall by a library's cross-correlation: a row of 0.017 mm, and under a column of 0.025 rad."""
# Of the pixels in the ring and away from its rims that an overlay was drawn over, at least so many are masked; of the
# ring, at most so much is farther from them than their edge reaches.
OVERLAY_FOUND = 0.95
OVERLAY_EXCESS = 0.002
# Where a tube's template is laid: half of its step along z and a change of scale over 4 mm; a column in θ.
TUBE_PLACE_MM = 0.06
TUBE_PLACE_RAD = 0.05
# Root mean square of 60 errors over their standard errors: 1/√120 is 0.09, times three; and few clusters.
TUBE_SIGMA_REL = 0.3
# What marks placed by closed forms give back: relative scale, and lengths, in noise of 3 µm over some hundred points.
TUBE_SCALE_REL = 0.004
TUBE_LENGTH_REL = 0.006
TUBE_SLANT_DEG = 0.6
# Depth by parallax, robust spread: what is asked for of the wall, and of floors up to 0.3 mm deep.
PARALLAX_WALL_MM = 0.02
PARALLAX_FLOOR_MM = 0.05

# The median and the mean of two thousand differences that scatter by 0.02 mm: four standard errors.
RELIEF_BIAS_MM = 0.0025
