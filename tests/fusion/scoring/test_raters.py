"""Drawings of several people: read, compared, agreed on."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import roifile
from bore_pairs import Pair
from numpy.typing import NDArray
from tolerances import STAPLE

from endoct.base.errors import EndoctError
from endoct.fusion.files.drawings import read_drawing
from endoct.fusion.files.masks import read_mask
from endoct.fusion.files.outlines import fill
from endoct.fusion.scoring.raters import Drawing, majority, rater_agreement, staple
from endoct.stitching.grid import SurfaceGrid

SHAPE = (40, 60)
GRID = SurfaceGrid.full_circle(*SHAPE, z0_mm=0.0, dz_mm=0.1, radius_mm=1.25)
SEEN = np.ones(SHAPE, np.bool_)
HEAD = "index,shape-type,vertex-index,axis-0,axis-1\n"


def drawing(rater: str, session: str, mask: NDArray[np.bool_]) -> Drawing:
    return Drawing(rater, session, mask, SEEN)


def shapes(path: Path, *outlines: tuple[str, list[tuple[float, float]]]) -> Path:
    lines = [
        f"{k},{kind},{v},{row},{column}\n"
        for k, (kind, points) in enumerate(outlines)
        for v, (row, column) in enumerate(points)
    ]
    path.write_text(HEAD + "".join(lines))
    return path


def test_shapes_of_napari(tmp_path: Path) -> None:
    box = [(9.5, 4.5), (9.5, 14.5), (19.5, 14.5), (19.5, 4.5)]
    path = shapes(tmp_path / "anna_2.csv", ("rectangle", box))
    mask = read_drawing(path, SHAPE)
    assert mask.sum() == 100
    assert mask[10:20, 5:15].all()
    oval = read_drawing(shapes(tmp_path / "e.csv", ("ellipse", box)), SHAPE)
    assert oval.sum() == pytest.approx(np.pi * 25, rel=0.06)
    assert not (oval & ~mask).any()


@pytest.mark.parametrize("turn", [-60, 0, 60, 120])
def test_outlines_run_over_the_seam(turn: int) -> None:
    mask = fill(np.add([[4.5, 54.5], [4.5, 64.5], [9.5, 64.5], [9.5, 54.5]], [0, turn]), SHAPE)
    assert mask.sum() == 50
    assert mask[5:10, 55:].all()
    assert mask[5:10, :5].all()


def test_regions_of_fiji(tmp_path: Path) -> None:
    box = roifile.ImagejRoi(roitype=roifile.ROI_TYPE.RECT, left=5, top=10, right=15, bottom=20, name="box")
    free = roifile.ImagejRoi.frompoints(np.array([[30, 2], [40, 2], [40, 6], [30, 6]], np.float32))
    box.tofile(tmp_path / "one.roi")
    assert read_drawing(tmp_path / "one.roi", SHAPE).sum() == 100
    roifile.roiwrite(tmp_path / "all.zip", [box, free])
    mask = read_drawing(tmp_path / "all.zip", SHAPE)
    assert mask[10:20, 5:15].all()
    assert mask[2:6, 30:40].all()
    assert mask.sum() == 140
    roifile.ImagejRoi(roitype=roifile.ROI_TYPE.LINE, name="l").tofile(tmp_path / "line.roi")
    with pytest.raises(EndoctError, match="encloses nothing; found line"):
        read_drawing(tmp_path / "line.roi", SHAPE)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv", "x,y\n1,2\n", "no napari shapes layer"),
        ("a.csv", HEAD, "no napari shapes layer"),
        ("a.csv", HEAD + "0,path,0,1,1\n0,path,1,2,2\n", "encloses nothing"),
        ("a.csv", HEAD + "0,polygon,0,1,x\n", "cannot be read"),
        ("a.csv", HEAD + "0,polygon,0,100,1\n0,polygon,1,101,1\n0,polygon,2,100,2\n", "shows no cells"),
        ("a.zip", "none", "holds no regions of ImageJ"),
        ("a.roi", "none", "holds no regions of ImageJ"),
    ],
)
def test_what_is_no_drawing(name: str, content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(EndoctError, match=message):
        read_drawing(tmp_path / name, SHAPE)


def test_outlines_need_a_panorama(tmp_path: Path) -> None:
    path = shapes(tmp_path / "a.csv", ("polygon", [(1, 1), (1, 5), (5, 5)]))
    with pytest.raises(EndoctError, match="nothing says where the outlines"):
        read_mask(path)


def test_rater_and_session_by_the_name_or_the_sidecar(pair: Pair, tmp_path: Path) -> None:
    for name, said in (("anna_2.png", ("anna", "2")), ("bea.png", ("bea", "1")), ("c_d_late.png", ("c_d", "late"))):
        cv2.imwrite(str(tmp_path / name), pair.cells_a.astype(np.uint8))
        mask = read_mask(tmp_path / name, pair.a)
        assert (mask.rater, mask.session) == said
    sidecar = 'modality = "mask"\nbore_diameter_mm = 2.5\nz0_mm = 0.0\ndz_mm = 0.05\nrater = "zoe"\n'
    (tmp_path / "bea.toml").write_text(sidecar)
    mask = read_mask(tmp_path / "bea.png", pair.a)
    assert (mask.rater, mask.session) == ("zoe", "1")


def test_within_and_between_raters() -> None:
    base = np.zeros(SHAPE, np.bool_)
    base[10:20, 10:30] = True
    found = rater_agreement(
        [
            drawing("a", "1", base),
            drawing("a", "2", np.roll(base, 1, axis=1)),
            drawing("b", "1", np.roll(base, 5, axis=1)),
        ],
        GRID,
        0.15,
    )
    assert [pair.within for pair in found.pairs] == [True, False, False]
    assert found.within.pairs == 1
    assert found.within.jaccard == pytest.approx(19 / 21)
    assert found.between.jaccard == pytest.approx(np.median([15 / 25, 16 / 24]))
    assert found.within.boundary_within_share == pytest.approx(1)
    assert found.between.boundary_p95_mm > 3 * GRID.dtheta_mm


def test_the_majority_counts_raters_not_sessions() -> None:
    a, b, c = (np.zeros(SHAPE, np.bool_) for _ in range(3))
    a[:20], b[10:30], c[10:40] = True, True, True
    found = majority([drawing("a", str(k), a) for k in range(5)] + [drawing("b", "1", b), drawing("c", "1", c)])
    assert found[10:30].all()
    assert not found[:10].any()
    assert not found[30:].any()


def test_staple_finds_who_draws_well() -> None:
    rng = np.random.default_rng(4)
    shape = (200, 200)
    truth = rng.random(shape) < 0.25
    performance = [(0.95, 0.98), (0.9, 0.95), (0.6, 0.97), (0.85, 0.75)]
    drawings = [
        Drawing(f"r{k}", "1", np.where(truth, rng.random(shape) < p, rng.random(shape) > q), np.ones(shape, np.bool_))
        for k, (p, q) in enumerate(performance)
    ]
    consensus, performed = staple(drawings, np.ones(shape, np.bool_))
    for row, (p, q) in zip(performed, performance, strict=True):
        assert row.sensitivity == pytest.approx(p, abs=STAPLE)
        assert row.specificity == pytest.approx(q, abs=STAPLE)
    by_majority = majority(drawings)
    assert (consensus != truth).mean() < 0.75 * (by_majority != truth).mean()
    assert (consensus != truth).mean() < min((d.mask != truth).mean() for d in drawings)
    with pytest.raises(ValueError, match="more than"):
        staple(drawings * 10, np.ones(shape, np.bool_))
