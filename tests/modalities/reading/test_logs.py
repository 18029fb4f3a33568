"""Image logs, LAS and DLIS, written by hand: what is read of them, and what is refused."""

from contextlib import nullcontext
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.modalities.reading import logs
from endoct.modalities.reading.logs import is_log, read_log
from endoct.modalities.reading.recording import stated_by
from endoct.modalities.recognition import recognise
from tests.modalities.reading.dlis_file import write_dlis
from tests.modalities.unrolled.drawn import OF_DEPTH, SAID, brightness, pits, write

IMAGE = brightness(pits(12, 36)).astype(np.float64)
DEPTHS = 106.8 + 0.006 * np.arange(12)


def las(path: Path, curves: list[str], rows: np.ndarray, unit: str = "M", null: str = "-999.25") -> Path:
    lines = ["~Version", "VERS. 2.0 : CWLS", "WRAP. NO : one line a depth", "~Well", f"NULL. {null} : null", "~Curve"]
    lines += [f"DEPT.{unit} : depth", *(f"{name}. : " for name in curves), "~ASCII"]
    lines += [" ".join(f"{value:.4f}" for value in (z, *row)) for z, row in zip(DEPTHS, rows, strict=True)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("form", ["AMP[{}]", "AMP{:02d}", "AMP_{}", "AMP:{}"])
def test_the_curves_of_a_las_are_one_image(tmp_path: Path, form: str) -> None:
    pytest.importorskip("lasio", reason="lasio of the extra 'logs' is not installed")
    rows = np.column_stack([np.arange(12), IMAGE])
    rows[3, 5] = -999.25
    path = las(tmp_path / "wall.las", ["GR", *(form.format(k) for k in range(36))], rows)
    values, index = read_log(path)
    expected = rows[:, 1:].copy()
    expected[3, 4] = np.nan
    assert np.array_equal(values, expected, equal_nan=True)
    assert np.allclose(index, DEPTHS)
    assert stated_by(path).keys == {"modality": "unrolled", "z_column_mm": 1000}


def test_a_channel_of_a_dlis_is_one_image(tmp_path: Path) -> None:
    pytest.importorskip("dlisio", reason="dlisio of the extra 'logs' is not installed")
    path = write_dlis(tmp_path / "wall.dlis", DEPTHS / 0.00254, {"AMP": IMAGE, "TT": 2 * IMAGE}, unit="0.1 in")
    for name, factor in (("AMP", 1), ("TT", 2)):
        values, index = read_log(path, name)
        assert np.array_equal(values, factor * IMAGE)
        assert np.allclose(index * 2.54, 1000 * DEPTHS, atol=0.01)
    assert stated_by(path).keys == {"modality": "unrolled", "z_column_mm": 2.54}
    with pytest.raises(EndoctError, match=r"AMP \(36\), TT \(36\)"):
        read_log(path)
    with pytest.raises(EndoctError, match="no such image"):
        read_log(path, "GR")
    feet = write_dlis(tmp_path / "feet.dlis", DEPTHS, {"AMP": IMAGE}, unit="FT")
    assert stated_by(feet).keys["z_column_mm"] == 304.8
    none = write_dlis(tmp_path / "none.dlis", DEPTHS, {"AMP": IMAGE}, has_index=False)
    with pytest.raises(EndoctError, match="no index"):
        read_log(none)


def test_a_file_that_ends_its_library_does_not_end_the_program(tmp_path: Path) -> None:
    """Two bytes of a table and of a row: dlisio 1.0.4 reads beyond its memory."""
    pytest.importorskip("dlisio", reason="dlisio of the extra 'logs' is not installed")
    path = write_dlis(tmp_path / "wall.dlis", DEPTHS, {"AMP": IMAGE})
    data = bytearray(path.read_bytes())
    data[389], data[492] = 255, 187
    path.write_bytes(data)
    with pytest.raises(EndoctError, match="cannot be read as a log") as error:
        read_log(path)
    assert "\n" not in str(error.value)


def test_a_log_is_unrolled_like_a_table_and_says_where_its_rows_lie(tmp_path: Path) -> None:
    pytest.importorskip("lasio", reason="lasio of the extra 'logs' is not installed")
    folder = write(tmp_path, None, intensity_file="wall.las", row_pitch_mm=None)
    las(folder / "wall.las", [f"AMP[{k}]" for k in range(36)], IMAGE)
    recording = recognise(folder)
    assert recording.manifest.name == "unrolled"
    assert recording.missing == {}
    stream = recording.open()
    assert np.array_equal(np.stack([frame.samples[:, 0] for frame in map(stream.__getitem__, range(12))]), IMAGE)
    assert [stream[k].z_mm for k in (0, 11)] == pytest.approx([0, 66], abs=1e-6)
    both = write(tmp_path / "both", None, row_pitch_mm=None, intensity_file="wall.las", intensity_curve="AMP",
                 **OF_DEPTH | {"depth_file": "wall.las", "centred": True}, depth_curve="TT")  # fmt: skip
    names = [f"{name}[{k}]" for name in ("AMP", "TT") for k in range(36)]
    las(both / "wall.las", names, np.hstack([IMAGE, IMAGE + 1000]))
    assert np.array_equal(recognise(both).open()[3].samples, np.column_stack([IMAGE[3], IMAGE[3] + 1000]))
    las(folder / "wall.las", [f"AMP[{k}]" for k in range(36)], IMAGE, unit="")
    assert any("z_column_mm" in key for key in recognise(folder).missing)
    (folder / "acquisition.toml").unlink()
    missing = recognise(folder / "wall.las").missing
    assert {"bore_diameter_mm", "travel", "handedness", "theta_origin_rad"} <= missing.keys() & SAID.keys()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("AMP[7]", "AMP[77]"), "one by one"),
        (lambda text: text.replace("AMP[35]", "AMP[36]"), "one by one"),
        (lambda text: text.replace("AMP", "GR").replace("[", "A").replace("]", "B"), "no curve of at least 32"),
        (lambda text: text.replace("106.8060", "x"), "cannot be read as a log|where its rows lie"),
        (lambda text: text.replace("106.8060", "-999.25"), "where its rows lie"),
        (lambda text: text[: text.index("~Curve")], "cannot be read|no curves|no image"),
        (lambda text: text[: text.index("~ASCII")], "cannot be read|no image|where its rows lie"),
        (lambda text: text[:-90], "cannot be read"),
    ],
)
def test_a_broken_las_is_refused_in_one_line(tmp_path: Path, change, said: str) -> None:
    pytest.importorskip("lasio", reason="lasio of the extra 'logs' is not installed")
    path = las(tmp_path / "wall.las", [f"AMP[{k}]" for k in range(36)], IMAGE)
    path.write_text(change(path.read_text()))
    with pytest.raises(EndoctError, match=said) as error:
        read_log(path)
    assert "\n" not in str(error.value)


def test_logs_are_told_by_how_they_begin(tmp_path: Path) -> None:
    begins = {
        "a": b"# made by hand\n\n ~Version\n", "b": b"~V", "c": b"   1V1.00RECORD 8192", "d": b"LASF\0\0", "e": b"",
        "f": b"~Well\n~Version", "g": b"   1V2.00RECORD 8192",
    }  # fmt: skip
    for name, begin in begins.items():
        (tmp_path / name).write_bytes(begin)
    assert [is_log(tmp_path / name) for name in begins] == [True, True, True, False, False, False, False]
    assert not is_log(tmp_path / "nowhere")


def test_a_file_that_gives_nothing_or_fails_is_no_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for read in (Mock(return_value=None), Mock(side_effect=OSError)):
        monkeypatch.setattr(logs, "open_regular", lambda _, read=read: nullcontext(Mock(read=read)))
        assert not is_log(tmp_path)


def test_without_its_library_a_log_is_refused_by_that(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "lasio", None)
    path = las(tmp_path / "wall.las", ["AMP[0]"], IMAGE[:, :1])
    with pytest.raises(EndoctError, match=r"no lasio.*endoct\[logs\]"):
        read_log(path)
