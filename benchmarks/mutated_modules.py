"""Which modules are mutated, which tests are their own, and mutants that tests once let through."""

from collections.abc import Mapping

FUSION, OCT, ENDOSCOPE = "tests/fusion", "tests/modalities/oct", "tests/modalities/endoscope"
TESTS: Mapping[str, tuple[str, ...]] = {
    "fusion/scoring/boundary.py": (
        f"{FUSION}/scoring/test_boundary.py",
        f"{FUSION}/scoring/test_scores.py",
    ),
    "fusion/scoring/budget.py": (f"{FUSION}/scoring/test_budget.py",),
    "fusion/scoring/cells.py": (
        f"{FUSION}/scoring/test_budget.py",
        f"{FUSION}/scoring/test_cells.py",
        f"{FUSION}/scoring/test_matched_cells.py",
    ),
    "fusion/scoring/intervals.py": (f"{FUSION}/scoring/test_intervals.py",),
    "fusion/scoring/overlap.py": (
        f"{FUSION}/scoring/test_overlap.py",
        f"{FUSION}/scoring/test_scores.py",
    ),
    "fusion/scoring/raters.py": (f"{FUSION}/scoring/test_raters.py",),
    "fusion/scoring/scores.py": (
        f"{FUSION}/scoring/test_reliefs.py",
        f"{FUSION}/scoring/test_scores.py",
    ),
    "fusion/registration/align.py": (
        f"{FUSION}/registration/test_align.py",
        f"{FUSION}/registration/test_confidence.py",
        f"{FUSION}/registration/test_stretch.py",
        f"{FUSION}/test_methods.py",
    ),
    "fusion/registration/search.py": (
        f"{FUSION}/registration/test_align.py",
        f"{FUSION}/registration/test_confidence.py",
        f"{FUSION}/registration/test_correlation.py",
    ),
    "fusion/registration/by_hand.py": (f"{FUSION}/registration/test_by_hand.py",),
    "fusion/registration/rigidity.py": (
        f"{FUSION}/registration/test_displacement.py",
        f"{FUSION}/registration/test_rigidity.py",
    ),
    "fusion/registration/equations.py": (f"{FUSION}/registration/test_refinement.py",),
    "fusion/registration/refinement.py": (f"{FUSION}/registration/test_refinement.py",),
    "fusion/registration/twist.py": (f"{FUSION}/registration/test_twist.py",),
    "fusion/segmentation/outlines.py": (
        f"{FUSION}/segmentation/test_lines.py",
        f"{FUSION}/segmentation/test_outlines.py",
    ),
    "fusion/segmentation/segment.py": (
        f"{FUSION}/segmentation/test_segment.py",
        f"{FUSION}/segmentation/test_by_depth.py",
        f"{FUSION}/segmentation/test_outlines.py",
    ),
    "fusion/segmentation/regions.py": (f"{FUSION}/segmentation/test_segment.py",),
    "fusion/segmentation/threshold.py": (f"{FUSION}/segmentation/test_threshold.py",),
    "fusion/geometry/alignment.py": (
        f"{FUSION}/registration/test_by_hand.py",
        f"{FUSION}/test_alignment.py",
    ),
    "fusion/geometry/placement.py": (f"{FUSION}/test_placement.py",),
    "fusion/evidence/evidence.py": (f"{FUSION}/evidence/test_evidence.py",),
    "fusion/evidence/relief.py": (
        f"{FUSION}/evidence/test_evidence.py",
        f"{FUSION}/segmentation/test_by_depth.py",
    ),
    "fusion/doubts.py": (f"{FUSION}/test_doubts.py",),
    "fusion/comparison.py": (f"{FUSION}/test_comparison.py",),
    "stitching/motion/feed.py": ("tests/stitching/motion/test_feed.py",),
    "base/numeric/ranks.py": ("tests/base/numeric/test_ranks.py",),
    "modalities/oct/surface/wall.py": (f"{OCT}/surface/test_wall.py",),
    "modalities/oct/surface/background.py": (f"{OCT}/surface/test_background.py",),
    "modalities/oct/surface/levels.py": (f"{OCT}/surface/test_levels.py",),
    "modalities/oct/surface/trust.py": (f"{OCT}/surface/test_trust.py",),
    "modalities/oct/surface/fixed_lines.py": (f"{OCT}/surface/test_fixed_lines.py",),
    "modalities/oct/doubts.py": (f"{OCT}/test_doubts.py",),
    "modalities/oct/unroll.py": (f"{OCT}/test_unroll.py",),
    "modalities/oct/undistort.py": (f"{OCT}/test_undistort.py",),
    "modalities/endoscope/doubts.py": (f"{ENDOSCOPE}/test_doubts.py",),
    "modalities/endoscope/frame_places.py": (f"{ENDOSCOPE}/test_frame_places.py",),
    "modalities/endoscope/motion.py": (f"{ENDOSCOPE}/test_motion.py",),
}
"""By module: the tests of its own."""
NAMED: tuple[tuple[str, str, str, str], ...] = (
    (
        "fusion/comparison.py",
        'one = Surface("", *placement.mask(cells[0].mask, a.panorama.valid))',
        'one = Surface("", placement.mask(cells[0].mask, a.panorama.valid)[0], np.ones_like(b.panorama.valid))',
        f"{FUSION}/test_comparison.py",
    ),
    ("fusion/scoring/cells.py", " & ~side.mask", "", f"{FUSION}/scoring/test_budget.py"),
    ("modalities/oct/surface/wall.py", "lead = n_theta // 4", "lead = 0", f"{OCT}/surface/test_wall.py"),
    ("base/numeric/ranks.py", "ERROR_PER_SIGMA = 1.25", "ERROR_PER_SIGMA = 1.0", "tests/base/numeric/test_ranks.py"),
    ("synthetic/draw.py", " - min(0.0, advance)", "", "tests/synthetic/test_draw.py"),
    ("modalities/oct/unroll.py", "(turn - 0.5)", "(turn + 0.5)", f"{OCT}/test_unroll.py"),
)
"""Mutants that tests once let through: module, text, what replaces it, and the tests that must fail."""
