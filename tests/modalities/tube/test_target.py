"""What a tube.toml says of a tube, by numbers worked out by hand."""

from pathlib import Path

import numpy as np
import pytest
import tomlkit
from printed_tube import TUBE

from endoct.base.errors import EndoctError
from endoct.modalities.tube.target import read_target


def test_relief_adds_rings_and_grooves() -> None:
    z = np.array([1.0, 3.5, 3.85, 7.0, 7.95])[:, None]
    far = np.array([np.pi])  # from both grooves at these z
    np.testing.assert_allclose(TUBE.relief_mm(z, far)[:, 0], [0, 0.4, 0, 0.4, 0])
    np.testing.assert_allclose(TUBE.relief_mm(z, np.array([0.0]))[:, 0], [0.3, 0.7, 0.3, 0.7, 0.3])


def test_axial_groove_lies_across_the_seam() -> None:
    half = 0.175 / 1.25
    z = np.array(1.0)
    inside = TUBE.inked(z, np.array([half - 0.01, 2 * np.pi - half + 0.01, half + 0.01, 2 * np.pi - half - 0.01]))
    assert inside.tolist() == [True, True, False, False]


def test_helix_goes_once_around_in_its_lead() -> None:
    assert TUBE.helix_rad(np.array(7.0)) == pytest.approx(1.5 + 2 * np.pi)
    axial, helical = TUBE.from_grooves_mm(np.array(1.75), np.array([1.5 + np.pi / 2 + 0.1]))
    assert helical[0] == pytest.approx(0.125)
    assert axial[0] == pytest.approx(1.25 * (1.6 + np.pi / 2 - (2 * np.pi if 1.6 + np.pi / 2 > np.pi else 0)))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"ring_z_mm": [7.0, 3.5]}, "two rings one after the other"),
        ({"ring_width_mm": [1.8, 1.8]}, "1.5 times as wide"),
        ({"outer_diameter_mm": 3.9}, "leaves a wall"),
        ({"helix_width_mm": 1.4}, "narrower than the bore's radius"),
        ({"groove_depht_mm": 0.3}, "groove_depth_mm"),
    ],
)
def test_tubes_that_cannot_be_are_refused(tmp_path: Path, change: dict[str, object], said: str) -> None:
    path = tmp_path / "tube.toml"
    path.write_text(tomlkit.dumps({**TUBE.model_dump(mode="json"), **change}))
    with pytest.raises(EndoctError, match=said):
        read_target(path)


def test_a_tube_comes_back_from_its_file(tmp_path: Path) -> None:
    path = tmp_path / "tube.toml"
    path.write_text(tomlkit.dumps(TUBE.model_dump(mode="json")))
    assert read_target(path) == TUBE


def test_lengths_along_the_tube_are_as_sure_as_the_distance_of_its_rings() -> None:
    errors = TUBE.standard_errors
    assert TUBE.stretch_sigma == pytest.approx(errors.z_mm / 3.5)
    np.testing.assert_allclose(TUBE.ring_edges_mm, [3.2, 3.8, 6.1, 7.9])
    np.testing.assert_allclose(TUBE.ring_inside_mm(np.array([3.3, 3.7, 5.0, 7.0, 8.0])), [0.1, 0.1, -1.1, 0.9, -0.1])
    assert TUBE.radius_mm == 1.25
    # at z = 0 the axial groove is 0.175 mm to either side of θ = 0, and the helix 0.25 mm of θ = 1.5
    theta = np.array([0.0, 0.1, 1.5, 1.5 + 0.1])
    np.testing.assert_allclose(TUBE.groove_inside_mm(np.array(0.0), theta), [0.175, 0.05, 0.25, 0.125], atol=1e-12)
