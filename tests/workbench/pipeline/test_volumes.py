"""What a volume is said to be, by its numbers and by what its file states."""

from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk

from endoct.modalities.ct.hounsfield import LEAST_HU
from endoct.workbench.pipeline.volumes import MOST_NAMED, describe_volume

COUNTING = np.arange(4 * 5 * 30).reshape(4, 5, 30)


def described(folder: Path, voxels: np.ndarray) -> dict[str, object]:
    image = sitk.GetImageFromArray(voxels)
    image.SetSpacing((0.5, 0.25, 2.0))
    image.SetOrigin((10.0, -20.0, 30.0))
    sitk.WriteImage(image, folder / "v.nrrd")
    return describe_volume(folder / "v.nrrd")


@pytest.mark.parametrize(
    ("voxels", "kind", "numbers"),
    [
        (COUNTING % MOST_NAMED, "label map", f"{MOST_NAMED} labels, which nothing names"),
        (COUNTING % (MOST_NAMED + 1), "volume", "not known"),
        (COUNTING % 2, "label map", "2 labels"),
        (COUNTING % 2 - 1, "volume", "not known"),
        (COUNTING - 600 + LEAST_HU, "CT", "Hounsfield units"),
    ],
)
def test_a_volume_is_told_by_its_numbers(tmp_path: Path, voxels: np.ndarray, kind: str, numbers: str) -> None:
    said = described(tmp_path, voxels.astype(np.int16))
    assert said["kind"] == kind
    assert str(said["numbers"]).startswith(numbers)


def test_fractions_are_no_labels(tmp_path: Path) -> None:
    assert described(tmp_path, (COUNTING % 2).astype(np.float32))["kind"] == "volume"


def test_where_it_lies_is_said_in_its_own_coordinates(tmp_path: Path) -> None:
    said = described(tmp_path, (COUNTING % 2).astype(np.uint8))
    assert said["voxels"] == [30, 5, 4]
    assert said["voxel_mm"] == [0.5, 0.25, 2.0]
    assert said["coordinates"] == "lps"
    assert said["from_mm"] == [10.0, -20.0, 30.0]
    assert said["to_mm"] == [10 + 29 * 0.5, -20 + 4 * 0.25, 30 + 3 * 2.0]
    assert said["values"] == [0, 1]
    assert said["certainty"] == "placed as its file says; nothing speaks against it"
