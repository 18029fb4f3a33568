"""The simulated tube against what its file states, which another module reads."""

import numpy as np

from endoct.modalities.tube.target import Target
from endoct.synthetic.bone.relief import bore_relief, wall_grid
from endoct.synthetic.draw import draw
from endoct.synthetic.specimen_files import tube_file

EVEN = {f"bore.{name}": (0.0, 0.0) for name in ("taper_mm", "wander_mm", "roughness_mm", "drill_mark_depth_mm")}


def test_marks_lie_where_the_file_says() -> None:
    exact = {f"tube.sigma_{name}_mm": (0.0, 0.0) for name in ("bore", "depth", "z")}
    sample = draw("tube", 7, ranges={**EVEN, **exact, "tube.edge_mm": (0.005, 0.005)})
    target, grid = Target.model_validate(tube_file(sample)), wall_grid(sample)
    relief = bore_relief(sample)
    z = (grid.dz_mm * np.arange(grid.n_z))[:, None]
    theta = 2 * np.pi / grid.n_theta * np.arange(grid.n_theta)
    clear = np.minimum(np.abs(target.ring_inside_mm(z)), np.abs(target.groove_inside_mm(z, theta))) > 0.015
    np.testing.assert_allclose(relief.displacement_mm[clear], target.relief_mm(z, theta)[clear], atol=2e-4)
    assert relief.ink is not None
    np.testing.assert_allclose(relief.ink[clear], target.inked(z, theta)[clear], atol=1e-3)


def test_errors_make_the_tube_larger_deeper_and_longer() -> None:
    sample = draw("tube", 7, ranges=EVEN)
    assert sample.bore.tube is not None
    off = {"bore_error": 2.0, "depth_error": 1.0, "z_error": 0.0, "sigma_bore_mm": 0.01, "sigma_depth_mm": 0.02}
    tube = sample.bore.tube.model_copy(update=off)
    changed = sample.model_copy(update={"bore": sample.bore.model_copy(update={"tube": tube})})
    relief = bore_relief(changed).displacement_mm
    dz = wall_grid(changed).dz_mm
    far = relief.shape[1] // 2  # on the other side of the axial groove
    assert abs(relief[round(1.2 / dz), far] - 0.01) < 2e-4
    assert abs(relief[round(tube.narrow_z_mm / dz), far] - 0.43) < 2e-4
