"""What `endoct info` says of a path, and the sidecar that it lays out."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from endoct.stitching.errors import EndoctError
from endoct.workbench.pipeline.information import describe
from endoct.workbench.pipeline.sidecar_template import write_sidecar_template


def frames(folder: Path) -> Path:
    folder.mkdir()
    for k in range(3):
        cv2.imwrite(str(folder / f"{k}.png"), np.full((40, 40, 3), 90 + k, np.uint8))
    return folder


@pytest.mark.parametrize("text", ["{", "[]", '{"sides": 1}', '{"aligned": true}', "[" * 100_000, "9" * 9_000, "\udcff"])
def test_a_damaged_comparison_is_one_line(text: str, tmp_path: Path) -> None:
    (tmp_path / "result.json").write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(EndoctError) as caught:
        describe(tmp_path)
    assert "\n" not in str(caught.value)


def test_a_template_is_laid_out_anew_with_the_keys_it_has(tmp_path: Path) -> None:
    sidecar, missing = write_sidecar_template(frames(tmp_path / "endo"), "endoscope", overwrite=False)
    assert "bore_diameter_mm" in missing
    sidecar.write_text(sidecar.read_text().replace("# bore_diameter_mm = ", "bore_diameter_mm = 2.5"))
    with pytest.raises(EndoctError, match="exists already"):
        write_sidecar_template(tmp_path / "endo", "endoscope", overwrite=False)
    _, missing = write_sidecar_template(tmp_path / "endo", None, overwrite=True)
    assert not missing
    assert "\nbore_diameter_mm = 2.5\n" in sidecar.read_text()


@pytest.mark.parametrize("mine", ["# measured twice\n", "travel = 'in'  # I saw it\n"])
def test_comments_of_the_user_are_not_overwritten(mine: str, tmp_path: Path) -> None:
    sidecar, _ = write_sidecar_template(frames(tmp_path / "endo"), "endoscope", overwrite=False)
    sidecar.write_text(sidecar.read_text() + mine)
    before = sidecar.read_text()
    with pytest.raises(EndoctError, match="was not written by endoct, or changed since"):
        write_sidecar_template(tmp_path / "endo", "endoscope", overwrite=True)
    assert sidecar.read_text() == before


@pytest.mark.parametrize("mine", ["feed_pich_mm = 0.2\n", "theta_origin_rad = nan\n"])
def test_a_value_that_would_be_lost_stops_it(mine: str, tmp_path: Path) -> None:
    sidecar, _ = write_sidecar_template(frames(tmp_path / "endo"), "endoscope", overwrite=False)
    sidecar.write_text(sidecar.read_text() + mine)
    before = sidecar.read_text()
    with pytest.raises(EndoctError):
        write_sidecar_template(tmp_path / "endo", "endoscope", overwrite=True)
    assert sidecar.read_text() == before


def test_keys_of_a_calibration_stay_there(tmp_path: Path) -> None:
    sidecar, _ = write_sidecar_template(frames(tmp_path / "endo"), "endoscope", overwrite=False)
    (tmp_path / "endo" / "😀.toml").write_text("bore_diameter_mm = 2.5\n", encoding="utf-8")
    sidecar.write_text(sidecar.read_text(encoding="utf-8") + 'calibration = "😀.toml"\n', encoding="utf-8")
    write_sidecar_template(tmp_path / "endo", "endoscope", overwrite=True)
    text = sidecar.read_text(encoding="utf-8")
    assert '\ncalibration = "😀.toml"\n' in text
    assert "\nbore_diameter_mm = 2.5" not in text
