"""Which modules are mutated, which tests are their own, and mutants that tests once let through."""

from collections.abc import Mapping

FUSION, OCT, ENDOSCOPE = "tests/fusion", "tests/modalities/oct", "tests/modalities/endoscope"
_BY_TEST: Mapping[str, tuple[str, ...]] = {
    f"{FUSION}/scoring/test_boundary.py {FUSION}/scoring/test_scores.py": ("fusion/scoring/boundary.py",),
    f"{FUSION}/scoring/test_budget.py": ("fusion/scoring/budget.py", "fusion/scoring/cells.py"),
    f"{FUSION}/scoring/test_cells.py": ("fusion/scoring/cells.py",),
    f"{FUSION}/scoring/test_matched_cells.py": ("fusion/scoring/cells.py",),
    f"{FUSION}/scoring/test_intervals.py": ("fusion/scoring/intervals.py",),
    f"{FUSION}/scoring/test_overlap.py {FUSION}/scoring/test_scores.py": (
        "fusion/scoring/overlap.py",
        "fusion/scoring/overlap.py",
    ),
    f"{FUSION}/scoring/test_raters.py": ("fusion/scoring/raters.py",),
    f"{FUSION}/scoring/test_scores.py": ("fusion/scoring/scores.py",),
    f"{FUSION}/registration/test_align.py {FUSION}/registration/test_confidence.py": (
        "fusion/registration/align.py",
        "fusion/registration/search.py",
    ),
    f"{FUSION}/registration/test_correlation.py {FUSION}/registration/test_confidence.py": (
        "fusion/registration/search.py",
        "fusion/registration/search.py",
    ),
    f"{FUSION}/registration/test_by_hand.py": ("fusion/registration/by_hand.py", "fusion/registration/by_hand.py"),
    f"{FUSION}/registration/test_displacement.py": ("fusion/registration/rigidity.py",),
    f"{FUSION}/registration/test_refinement.py": (
        "fusion/registration/equations.py",
        "fusion/registration/refinement.py",
    ),
    f"{FUSION}/registration/test_rigidity.py": ("fusion/registration/rigidity.py",),
    f"{FUSION}/registration/test_stretch.py": ("fusion/registration/align.py",),
    f"{FUSION}/registration/test_twist.py": ("fusion/registration/twist.py",),
    f"{FUSION}/segmentation/test_lines.py": ("fusion/segmentation/outlines.py",),
    f"{FUSION}/segmentation/test_outlines.py": ("fusion/segmentation/outlines.py",),
    f"{FUSION}/segmentation/test_segment.py": ("fusion/segmentation/segment.py", "fusion/segmentation/regions.py"),
    f"{FUSION}/segmentation/test_segment.py {FUSION}/segmentation/test_outlines.py": (
        "fusion/segmentation/segment.py",
    ),
    f"{FUSION}/segmentation/test_threshold.py": ("fusion/segmentation/threshold.py",),
    f"{FUSION}/test_alignment.py": ("fusion/geometry/alignment.py",),
    f"{FUSION}/test_placement.py": (
        "fusion/geometry/placement.py",
        "fusion/geometry/resample.py",
    ),
    f"{FUSION}/evidence/test_evidence.py": ("fusion/evidence/evidence.py", "fusion/evidence/relief.py"),
    f"{FUSION}/test_doubts.py": ("fusion/doubts.py",),
    f"{FUSION}/test_comparison.py": ("fusion/comparison.py",),
    "tests/stitching/test_feed.py": ("stitching/motion/feed.py", "stitching/motion/feed.py"),
    "tests/stitching/test_robust.py": ("base/numeric/ranks.py",),
    f"{OCT}/surface/test_wall.py": ("modalities/oct/surface/wall.py",),
    f"{OCT}/surface/test_evidence.py": ("modalities/oct/surface/evidence.py",),
    f"{OCT}/surface/test_bore.py": ("modalities/oct/surface/wall.py",),
    f"{OCT}/surface/test_levels.py": ("modalities/oct/surface/levels.py",),
    f"{OCT}/surface/test_noise_floor.py": ("modalities/oct/surface/levels.py",),
    f"{OCT}/surface/test_second_look.py": ("modalities/oct/surface/second_look.py",),
    f"{OCT}/surface/test_trust.py": ("modalities/oct/surface/trust.py",),
    f"{OCT}/surface/test_lines_of_a_recording.py {OCT}/surface/test_fixed_lines.py": (
        "modalities/oct/surface/fixed_lines.py",
    ),
    f"{OCT}/test_doubts.py": ("modalities/oct/doubts.py",),
    f"{OCT}/test_settle.py": ("modalities/oct/settle.py",),
    f"{OCT}/test_undistort.py": ("modalities/oct/undistort.py",),
    f"{ENDOSCOPE}/test_ring_doubts.py": ("modalities/endoscope/doubts.py",),
    f"{ENDOSCOPE}/motion/test_feed_and_nominal.py": ("modalities/endoscope/motion/places.py",),
    f"{ENDOSCOPE}/motion/test_offset.py": ("modalities/endoscope/motion/motion.py",),
}
TESTS: Mapping[str, tuple[str, ...]] = {
    module: tuple(tests.split()) for tests, modules in _BY_TEST.items() for module in modules
}
"""By module: the tests of its own."""
NAMED: tuple[tuple[str, str, str, str], ...] = (
    (
        "fusion/comparison.py",
        'one = Surface("", *placement.mask(a.segmentation.mask, a.side.panorama.valid))',
        'one = Surface("", placement.mask(a.segmentation.mask, a.side.panorama.valid)[0], np.ones_like(observed))',
        f"{FUSION}/test_comparison.py",
    ),
    ("fusion/scoring/cells.py", " & ~side.mask", "", f"{FUSION}/scoring/test_budget.py"),
    ("modalities/oct/surface/wall.py", "lead = n_theta // 4", "lead = 0", f"{OCT}/surface/test_wall.py"),
    ("base/numeric/ranks.py", "ERROR_PER_SIGMA = 1.25", "ERROR_PER_SIGMA = 1.0", "tests/stitching/test_robust.py"),
    ("synthetic/draw.py", " - min(0.0, advance)", "", "tests/synthetic/test_draw.py"),
    ("modalities/oct/settle.py", "(turn - 0.5)", "(turn + 0.5)", f"{OCT}/test_settle.py"),
)
"""Mutants that tests once let through: module, text, what replaces it, and the tests that must fail."""
