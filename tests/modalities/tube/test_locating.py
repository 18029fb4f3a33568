"""Where a tube lies in a recording: found in every orientation, in noise, with parts unseen."""

import numpy as np
import pytest
from printed_tube import TUBE
from tolerances import TUBE_PLACE_MM, TUBE_PLACE_RAD

from endoct.base.errors import NotSeen
from endoct.modalities.tube.locating import COLUMNS, check_rings, clear_pose

ROWS_MM = 0.25 * np.arange(32)


def recorded(z0: float, scale: float, direction: int, theta0: float, sense: int, noise_mm: float = 0.1) -> np.ndarray:
    theta = theta0 + sense * 2 * np.pi / COLUMNS * np.arange(COLUMNS)
    image = TUBE.relief_mm((z0 + direction * scale * ROWS_MM)[:, None], theta)
    image = image + noise_mm * np.random.default_rng(1).standard_normal(image.shape)
    image[5] = np.nan
    image[10:20, 100:] = np.nan
    return image


@pytest.mark.parametrize(("direction", "sense"), [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_every_orientation_is_found(direction: int, sense: int) -> None:
    z0 = 1.8 if direction > 0 else 10.1
    image = recorded(z0, 1.03, direction, 6.2, sense)
    pose = clear_pose(image, ROWS_MM, TUBE, TUBE.relief_mm, (0.97, 1.0, 1.03))
    assert (pose.direction, pose.sense, pose.scale) == (direction, sense, 1.03)
    assert pose.z_mm == pytest.approx(z0, abs=TUBE_PLACE_MM)
    assert np.angle(np.exp(1j * (pose.theta_rad - 6.2))) == pytest.approx(0, abs=TUBE_PLACE_RAD)


def test_noise_is_no_tube() -> None:
    image = np.random.default_rng(2).standard_normal((32, COLUMNS))
    with pytest.raises(NotSeen, match="marks of the tube are not seen"):
        clear_pose(image, ROWS_MM, TUBE, TUBE.relief_mm, (1.0,))


def test_grooves_alone_do_not_tell_which_way() -> None:
    theta = 2 * np.pi / COLUMNS * np.arange(COLUMNS)
    grooves = TUBE.groove_depth_mm * TUBE.inked((2 + ROWS_MM)[:, None], theta)

    def template(z_mm: np.ndarray, theta_rad: np.ndarray) -> np.ndarray:
        return TUBE.groove_depth_mm * TUBE.inked(z_mm, theta_rad)

    with pytest.raises(NotSeen, match="which way the tube lies"):
        clear_pose(grooves, ROWS_MM, TUBE, template, (1.0,))


@pytest.mark.parametrize("direction", [1, -1])
def test_faint_rings_tell_which_way(direction: int) -> None:
    """Grooves that are much darker lie on themselves when the tube is turned end for end."""
    z_mm = 6 + direction * (np.arange(200) * 0.04 - 4)
    theta = direction * 2 * np.pi / COLUMNS * np.arange(COLUMNS)
    dark = TUBE.inked(z_mm[:, None], theta) + 0.05 * (TUBE.ring_inside_mm(z_mm) > 0)[:, None]
    dark = dark + 0.2 * np.random.default_rng(3).standard_normal(dark.shape)

    def template(z_mm: np.ndarray, theta_rad: np.ndarray) -> np.ndarray:
        return TUBE.inked(z_mm, theta_rad) + 0.2 * (TUBE.ring_inside_mm(z_mm) > 0)

    pose = clear_pose(dark, np.arange(200) * 0.04, TUBE, template, (1.0,))
    assert (pose.direction, pose.sense) == (direction, direction)


@pytest.mark.parametrize(("z_mm", "said"), [((2.0, 6.5), "the narrow one alone"), ((4.0, 6.0), "neither")])
def test_both_rings_are_needed(z_mm: tuple[float, float], said: str) -> None:
    with pytest.raises(NotSeen, match=said):
        check_rings(TUBE, np.arange(*z_mm, 0.2))
