"""ThorImage files: what is read of each kind, what a header may get wrong, and what ends in one line."""

import io
import pickle
import struct
import zipfile
import zlib
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from endoct.base.errors import EndoctError
from endoct.modalities.reading.recording import ImageStack, open_stack, stated_by
from endoct.modalities.reading.thorlabs import open_scan, read_ascans
from tests.modalities.thorlabs_writer import Oct, raw_file, with_vectors

RNG = np.random.default_rng(0)
SLICES, ASCANS, DEPTH = 5, 80, 64
LEVELS = RNG.normal(40, 8, (SLICES, ASCANS, DEPTH)).astype(np.float32)
SPECTRA = RNG.integers(0, 4096, (SLICES, ASCANS, 2 * DEPTH)).astype(np.uint16)
DARK = RNG.integers(0, 4096, (6, 2 * DEPTH)).astype(np.uint16)
CHIRP = np.linspace(0.25, 2 * DEPTH - 1, 2 * DEPTH)


def intensity(**fields: Any) -> Oct:
    size = (DEPTH, ASCANS, SLICES)
    made = Oct(**{"size": size, "range_mm": (0.64, 10.0, 3.0), **fields}).add("Intensity", LEVELS)
    return made.add("VideoImage", RNG.integers(0, 255, (4, 6), dtype=np.uint32), Type="Colored")


def frames(stack: ImageStack) -> np.ndarray:
    return np.stack([stack[k] for k in range(len(stack))])


def spectra_of(path: Path) -> np.ndarray:
    """The spectra (B-scan, A-scan, sample) where the reader found them."""
    first = open_scan((path,)).first
    return np.stack([read_ascans(each.ascans, first.n_samples, first.dtype) for each in first.bscans])


def refused(path: Path) -> str:
    with pytest.raises(EndoctError) as caught:
        frames(open_stack(path))
    assert "\n" not in str(caught.value)
    return str(caught.value)


def codes(path: Path) -> list[str]:
    return [doubt.code for doubt in open_scan((path,)).remarks.doubts]


@pytest.mark.parametrize("compression", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
@pytest.mark.parametrize("separator", ["\\", "/"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "iso-8859-1"])
def test_levels_in_db_are_read_as_they_are(separator: str, encoding: str, compression: int, tmp_path: Path) -> None:
    path = intensity().write(tmp_path / "scan.oct", separator=separator, encoding=encoding, compression=compression)
    for at in (path, tmp_path):
        np.testing.assert_array_equal(frames(open_stack(at)), LEVELS.transpose(0, 2, 1))
        stated = stated_by(at)
        assert stated.keys == {
            "modality": "oct",
            "axial_pixel_mm": pytest.approx(0.01),
            "intensity": "log",
            "db_per_count": 1.0,
        }
        assert stated.by == "the header of scan.oct"


def test_complex_samples_become_db(tmp_path: Path) -> None:
    samples = np.zeros((2, ASCANS, DEPTH), np.complex64)
    samples[0, 0, 3], samples[1, 2, 1] = 3 + 4j, 100j
    path = Oct(size=(DEPTH, ASCANS, 2)).add("Complex", samples).write(tmp_path / "scan.oct")
    found = frames(open_stack(path))
    assert found[0, 3, 0] == pytest.approx(20 * np.log10(5), abs=1e-4)
    assert found[1, 1, 2] == pytest.approx(40, abs=1e-4)
    assert found[0, 0, 0] == pytest.approx(-100)
    assert stated_by(path).keys["intensity"] == "log"


def test_one_bscan_has_no_third_size(tmp_path: Path) -> None:
    path = Oct(size=(DEPTH, ASCANS, 1), mode="Mode2D").add("Intensity", LEVELS[0]).write(tmp_path / "scan.oct")
    np.testing.assert_array_equal(frames(open_stack(path)), LEVELS[:1].transpose(0, 2, 1))


def test_streams_are_shared_and_pickled(tmp_path: Path) -> None:
    for k, compression in enumerate((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)):
        stack = open_stack(intensity().write(tmp_path / f"{k}.oct", compression=compression))
        copied = pickle.loads(pickle.dumps(stack))
        with ThreadPoolExecutor(4) as pool:
            for index, frame in enumerate(pool.map(copied.__getitem__, list(range(SLICES)) * 8)):
                np.testing.assert_array_equal(frame, LEVELS[index % SLICES].T)


def test_a_file_that_changes_is_read_anew(tmp_path: Path) -> None:
    path = intensity().write(tmp_path / "scan.oct", compression=zipfile.ZIP_DEFLATED)
    frames(open_stack(path))
    Oct(size=(DEPTH, ASCANS, 2)).add("Intensity", LEVELS[3:]).write(path, compression=zipfile.ZIP_DEFLATED)
    np.testing.assert_array_equal(frames(open_stack(path)), LEVELS[3:].transpose(0, 2, 1))


def test_bscans_are_taken_where_raw_spectra_lie_beside_them(tmp_path: Path) -> None:
    made = raw_file(SPECTRA, CHIRP).add("Intensity", LEVELS)
    stack = open_stack(made.write(tmp_path / "scan.oct"))
    np.testing.assert_array_equal(frames(stack), LEVELS.transpose(0, 2, 1))
    assert "The file holds B-scans and raw spectra; the B-scans were read." in stack.remarks.notes


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (Oct().add("Intensity", LEVELS.astype("u4"), Type="Colored"), "coloured images alone, whose colours cannot"),
        (Oct().add("SpectralFloat", LEVELS[0]), "single A-scans"),
        (Oct(mode="Mode1D").add("Phase", LEVELS[0]), "single A-scans"),
        (Oct().add("Phase", LEVELS), "data of the kinds Real"),
        (Oct(), "no data"),
        (Oct().add("PreviewImage", LEVELS), "no data"),
        (Oct().add("Intensity", LEVELS, BytesPerPixel=1), "1 bytes a sample; expected 4, for Real"),
        (Oct().add("Intensity", LEVELS, SizeX=81), "holds no whole B-scans"),
        (Oct().add("Intensity", LEVELS, SizeX=0, SizeZ=10**9), "asks for too much memory"),
        (Oct().add("Intensity", LEVELS, SizeX=10**12), "no count"),
        (Oct().add("Intensity", LEVELS, SizeX="many"), "no count; found many"),
        (Oct().add("Intensity", LEVELS, RangeZ="nan"), "no number; found nan"),
        (Oct().add("Intensity", LEVELS, RangeZ="0,64"), "no number; found 0,64; expected one with a point"),
        (Oct().add("Intensity", LEVELS).add("Intensity", LEVELS), "two members of one name"),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_what_is_not_read_is_refused_with_the_reason(made: Oct, said: str, tmp_path: Path) -> None:
    assert said in refused(made.write(tmp_path / "scan.oct"))


def test_a_member_that_is_missing(tmp_path: Path) -> None:
    path = intensity().write(tmp_path / "scan.oct", leave_out=("Intensity",))
    assert "is incomplete; found no data/intensity.data" in refused(path)


def test_another_order_of_axes_is_refused(tmp_path: Path) -> None:
    made = intensity()
    assert "samples in the order XYZ" in refused(
        made.write(tmp_path / "scan.oct", header=made.header().replace("ZXYT", "XYZ"))
    )


# what headers say of depth


def test_the_range_of_raw_spectra_is_that_of_the_image(tmp_path: Path) -> None:
    """As in the header of a GAN632: 1.655808 mm over 1024 depth samples, of 2048 samples of a spectrum."""
    path = raw_file(SPECTRA, CHIRP, range_mm=(1.655808, 10.0, 3.0)).write(tmp_path / "scan.oct")
    assert stated_by(path).keys["axial_pixel_mm"] == pytest.approx(1.655808 / DEPTH)


def test_a_refractive_index_is_undone_and_doubted(tmp_path: Path) -> None:
    path = intensity(index=1.33).write(tmp_path / "scan.oct")
    keys = stated_by(path).keys
    assert (keys["axial_pixel_mm"], keys["medium_index"]) == (pytest.approx(0.0133), 1.33)
    assert codes(path) == ["thorlabs-index"]
    assert "medium_index" not in stated_by(intensity().write(tmp_path / "other.oct")).keys
    impossible = intensity(index=0.0).write(tmp_path / "zero.oct")
    assert not stated_by(impossible).keys.keys() & {"axial_pixel_mm", "medium_index"}
    assert codes(impossible) == ["thorlabs-index"]


def test_what_contradicts_itself_is_not_stated(tmp_path: Path) -> None:
    made = Oct(size=(DEPTH, ASCANS, SLICES)).add("Intensity", LEVELS, RangeZ=0.7)
    path = made.write(tmp_path / "scan.oct")
    assert "axial_pixel_mm" not in stated_by(path).keys
    assert codes(path) == ["thorlabs-depth"]
    header = made.header().replace('Unit="mm"', 'Unit="um"')
    in_um = made.write(tmp_path / "um.oct", header=header)
    assert stated_by(in_um).keys["axial_pixel_mm"] == pytest.approx(0.7 / DEPTH)
    assert codes(in_um) == []


def test_the_scanners_range_is_no_pullback(tmp_path: Path) -> None:
    path = intensity().write(tmp_path / "scan.oct")
    assert "pullback_pitch_mm" not in stated_by(path).keys
    assert any("3 mm across the B-scans" in note for note in open_stack(path).remarks.notes)


# where raw spectra lie


def test_raw_spectra_alone_are_no_frames(tmp_path: Path) -> None:
    path = raw_file(SPECTRA, CHIRP).write(tmp_path / "scan.oct")
    assert "read it with modality='oct'" in refused(path)
    np.testing.assert_array_equal(spectra_of(path), SPECTRA)


@pytest.mark.parametrize("sign", [False, True])
def test_the_type_is_what_the_header_says(sign: bool, tmp_path: Path) -> None:
    spectra = SPECTRA.astype(np.int16) - 2000 if sign else SPECTRA
    path = raw_file(spectra, CHIRP).write(tmp_path / "scan.oct")
    np.testing.assert_array_equal(spectra_of(path), spectra)
    assert stated_by(path).keys["spectra"] == {
        "file": "scan.oct",
        "samples": 2 * DEPTH,
        "ascans": ASCANS,
        "sample_type": "i16" if sign else "u16",
        "chirp": "data/Chirp.data",
        "offset": "data/OffsetErrors.data",
        "electrons_per_count": 540.0,
    }


def apodised_by(path: Path) -> list[np.ndarray | None]:
    first = open_scan((path,)).first
    return [
        None if each.apodised is None else read_ascans(each.apodised, first.n_samples, first.dtype)
        for each in first.bscans
    ]


def test_spectra_without_the_sample_are_no_ascans(tmp_path: Path) -> None:
    path = raw_file(SPECTRA, CHIRP, apodisation=DARK).write(tmp_path / "scan.oct")
    np.testing.assert_array_equal(spectra_of(path), SPECTRA)
    for found in apodised_by(path):
        np.testing.assert_array_equal(found, DARK)


def file_of(frame: np.ndarray, n: int = SLICES, name: str = "Spectral0", **attributes: Any) -> Oct:
    made = Oct(size=(DEPTH, ASCANS, n)).add(name, frame, **attributes)
    return with_vectors(made, CHIRP)


def test_the_first_member_may_be_the_apodisation(tmp_path: Path) -> None:
    made = file_of(DARK, ApoRegionStart0=0, ApoRegionEnd0=len(DARK))
    for k, spectra in enumerate(SPECTRA):
        made.add(f"Spectral{k + 1}", spectra)
    path = made.write(tmp_path / "scan.oct")
    np.testing.assert_array_equal(spectra_of(path), SPECTRA)
    for found in apodised_by(path):
        np.testing.assert_array_equal(found, DARK)
    assert codes(path) == []


ALL = SPECTRA.reshape(-1, 2 * DEPTH)
EACH = np.concatenate([np.concatenate([DARK, spectra]) for spectra in SPECTRA])
BEFORE = np.concatenate([DARK, ALL])


@pytest.mark.parametrize(
    ("frame", "attributes"),
    [
        (SPECTRA, {}),  # a third size
        (ALL, {}),
        (ALL, {"SizeX": ASCANS}),  # the header speaks of one B-scan
        (EACH, {"SizeX": ASCANS + 6, "ApoRegionEnd0": 6, "ScanRegionStart0": 6, "ScanRegionEnd0": ASCANS + 6}),
        (EACH, {"ApoRegionEnd0": 6, "ScanRegionStart0": 6, "ScanRegionEnd0": len(EACH)}),
        (BEFORE, {"ApoRegionEnd0": 6, "ScanRegionStart0": 6, "ScanRegionEnd0": len(BEFORE)}),
        (
            EACH,
            {f"ScanRegionStart{k}": 6 + k * (ASCANS + 6) for k in range(SLICES)}
            | {f"ScanRegionEnd{k}": (k + 1) * (ASCANS + 6) for k in range(SLICES)},
        ),
    ],
)
def test_all_bscans_may_lie_in_one_member(frame: np.ndarray, attributes: dict[str, Any], tmp_path: Path) -> None:
    path = file_of(frame, **attributes).write(tmp_path / "scan.oct")
    np.testing.assert_array_equal(spectra_of(path), SPECTRA)
    assert codes(path) == []


def test_repeats_of_a_place_are_said_also_where_the_header_hides_them(tmp_path: Path) -> None:
    twice = SPECTRA[:4]
    said = raw_file(twice, CHIRP, averaged={"SlowAxis": 2})
    said.size = (DEPTH, ASCANS, 2)
    path = said.write(tmp_path / "said.oct")
    np.testing.assert_array_equal(spectra_of(path), twice[::2])
    assert codes(path) == []
    assert any("2 B-scans at every place" in note for note in open_scan((path,)).remarks.notes)
    said.averaged = {}
    path = said.write(tmp_path / "hidden.oct")
    np.testing.assert_array_equal(spectra_of(path), twice[::2])
    (doubt,) = open_scan((path,)).remarks.doubts
    assert (doubt.code, doubt.value, doubt.expected) == ("thorlabs-averaging", 2.0, 1.0)


@pytest.mark.parametrize("raw", [True, False])
def test_a_negative_width_says_that_all_bscans_are_of_one_place(raw: bool, tmp_path: Path) -> None:
    for width_mm, read in ((-1.0, 1), (0.0, SLICES), (3.0, SLICES)):
        sizes = {"range_mm": (0.64, 10.0, width_mm)}
        made = raw_file(SPECTRA, CHIRP, averaged={"SlowAxis": 1}, **sizes) if raw else intensity(**sizes)
        path = made.write(tmp_path / "scan.oct")
        recording = open_scan((path,))
        assert len(recording.bscans) == read
        assert recording.first.n_ascans == ASCANS
        assert any("Of 5 B-scans at every place" in note for note in recording.remarks.notes) == (read == 1)
        assert codes(path) == []


def test_spectra_that_are_missing_in_between_are_refused(tmp_path: Path) -> None:
    made = raw_file(SPECTRA, CHIRP)
    del made.members[2:4]
    assert "is incomplete; found no spectra between 1 and 4" in refused(made.write(tmp_path / "scan.oct"))


def test_averaged_ascans_are_read_singly(tmp_path: Path) -> None:
    made = raw_file(SPECTRA, CHIRP, averaged={"AScans": 2})
    made.size = (DEPTH, ASCANS // 2, SLICES)
    path = made.write(tmp_path / "scan.oct")
    np.testing.assert_array_equal(spectra_of(path), SPECTRA)
    assert codes(path) == []
    made.size = (DEPTH, 33, SLICES)
    assert codes(made.write(path)) == ["thorlabs-count"]


def test_bscans_are_counted(tmp_path: Path) -> None:
    fewer = intensity(size=(DEPTH, ASCANS, SLICES)).write(tmp_path / "a.oct")
    assert codes(fewer) == []
    lying = Oct(size=(DEPTH, ASCANS, 9)).add("Intensity", LEVELS, SizeY=9).write(tmp_path / "b.oct")
    assert codes(lying) == ["thorlabs-count"]
    assert len(open_stack(lying)) == SLICES
    made = raw_file(SPECTRA, CHIRP)
    made.size = (DEPTH, ASCANS, 7)
    assert codes(made.write(tmp_path / "c.oct")) == ["thorlabs-count"]
    made = raw_file(SPECTRA, CHIRP)
    made.members.append(("Spectral77", SPECTRA[0].tobytes(), None))
    assert codes(made.write(tmp_path / "d.oct")) == ["thorlabs-count"]


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (file_of(SPECTRA[0], 1, BytesPerPixel=4), "4 bytes a sample"),
        (file_of(SPECTRA[0][:, :-1], 1), "one even number for all"),
        (file_of(SPECTRA[0], 1, ScanRegionEnd0=999), "fewer A-scans than its regions"),
        (file_of(SPECTRA[0], 1, SizeZ=100), "holds no whole frames"),
        (file_of(SPECTRA[0], 2).add("Spectral1", SPECTRA[0][:70]), "no B-scans of one size"),
        (file_of(DARK, 1, ApoRegionEnd0=6), "apodisation alone"),
        (file_of(DARK, 2, ApoRegionEnd0=6).add("Spectral1", DARK, ApoRegionEnd0=6), "apodisation alone"),
    ],
)
def test_spectra_that_do_not_fit(made: Oct, said: str, tmp_path: Path) -> None:
    assert said in refused(made.write(tmp_path / "scan.oct"))


def test_what_need_not_be_there(tmp_path: Path) -> None:
    made = raw_file(SPECTRA, CHIRP, electrons_per_count=0)
    header = made.header().replace("<Timestamp>1700000000", "<Timestamp>2023-11-14T22:13")
    path = made.write(tmp_path / "scan.oct", header=header)
    np.testing.assert_array_equal(spectra_of(path), SPECTRA)
    assert "electrons_per_count" not in stated_by(path).keys["spectra"]
    assert any("how many electrons a count is" in note for note in open_scan((path,)).remarks.notes)


def test_a_sign_is_not_guessed(tmp_path: Path) -> None:
    made = raw_file(SPECTRA, CHIRP)
    header = made.header().replace("<RawDataIsSigned>False</RawDataIsSigned>", "")
    assert "expected RawDataIsSigned" in refused(made.write(tmp_path / "scan.oct", header=header))


# a folder with a file for every stop


def stops(folder: Path, names: list[str], times: list[int] | None = None, **fields: Any) -> Path:
    folder.mkdir()
    for k, name in enumerate(names):
        made = Oct(size=(DEPTH, ASCANS, 1), mode="Mode2D", timestamp=times[k] if times else 0, **fields)
        made.add("Intensity", LEVELS[k % SLICES] + np.float32(k)).write(folder / name)
    return folder


def order_of(folder: Path) -> list[int]:
    """Which of the stops as they were given is read first, second, …"""
    read = frames(open_stack(folder))
    given = [(LEVELS[k % SLICES] + np.float32(k)).T for k in range(len(read))]
    return [next(k for k, frame in enumerate(given) if np.array_equal(frame, each)) for each in read]


def test_stops_are_put_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    names = [f"Bore_{k:04d}_Mode2D.oct" for k in (3, 1, 2, 5)]
    stack = open_stack(stops(tmp_path / "a", names, [300, 100, 200, 500]))
    assert order_of(tmp_path / "a") == [1, 2, 0, 3]
    assert stack.along is not None
    np.testing.assert_array_equal(stack.along.values, [0, 1, 2, 4])  # one is missing
    assert stack.remarks.doubts == ()
    assert stated_by(tmp_path / "a").by == "the headers of 4 .oct files"
    flushed = stops(tmp_path / "b", names, index=1.33)
    assert [doubt.code for doubt in open_stack(flushed).remarks.doubts] == ["thorlabs-index"]


def test_times_order_what_names_do_not(tmp_path: Path) -> None:
    stack = open_stack(stops(tmp_path / "a", ["deep.oct", "apical.oct", "mid.oct"], [300, 100, 200]))
    assert order_of(tmp_path / "a") == [1, 2, 0]
    assert any("times in their headers" in note for note in stack.remarks.notes)
    doubts = open_stack(stops(tmp_path / "b", ["deep.oct", "apical.oct", "mid.oct"])).remarks.doubts
    assert [doubt.code for doubt in doubts] == ["names-without-numbers"]


def test_names_against_times_are_doubted(tmp_path: Path) -> None:
    names = [f"stop{k}.oct" for k in (1, 2, 3)]
    stack = open_stack(stops(tmp_path / "a", names, [100, 300, 200]))
    assert order_of(tmp_path / "a") == [0, 1, 2]
    (doubt,) = stack.remarks.doubts
    assert doubt.code == "stops-order"
    assert "stop3.oct follows stop2.oct" in doubt.what


@pytest.mark.parametrize("numbered", [True, False])
def test_stops_of_equal_time_are_in_no_order_by_it(numbered: bool, tmp_path: Path) -> None:
    """Equal times contradict no order, and give none."""
    names = [f"stop{k}.oct" for k in (1, 2, 3)] if numbered else ["apical.oct", "deep.oct", "mid.oct"]
    codes = [] if numbered else ["names-without-numbers"]
    for k, times in enumerate(([100, 100, 100], [100, 100, 300], [100, 300, 300])):
        stack = open_stack(stops(tmp_path / f"{k}", names, times))
        assert order_of(tmp_path / f"{k}") == [0, 1, 2]
        assert [doubt.code for doubt in stack.remarks.doubts] == codes
        assert not any("times in their headers" in note for note in stack.remarks.notes)
    stack = open_stack(stops(tmp_path / "back", names, [300, 300, 100]))
    assert order_of(tmp_path / "back") == [0, 1, 2]
    assert [doubt.code for doubt in stack.remarks.doubts] == [*codes, "stops-order"]
    assert f"{names[2]} follows {names[1]}" in stack.remarks.doubts[-1].what
    stack = open_stack(stops(tmp_path / "some", names, [300, 0, 100]))  # one of which nobody said when
    assert order_of(tmp_path / "some") == [0, 1, 2]
    assert [doubt.code for doubt in stack.remarks.doubts] == codes


def test_stops_with_several_bscans_or_of_several_kinds(tmp_path: Path) -> None:
    folder = stops(tmp_path / "a", ["s1.oct", "s2.oct", "s3.oct"], range_mm=(0.64, 10.0, 0.0))
    several = Oct(size=(DEPTH, ASCANS, 3), range_mm=(0.64, 10.0, 0.0)).add("Intensity", LEVELS[:3])
    several.write(folder / "s2.oct")  # the only one with a time
    stack = open_stack(folder)
    np.testing.assert_array_equal(stack[1], LEVELS[0].T)
    assert (len(stack), [doubt.code for doubt in stack.remarks.doubts]) == (3, ["stops-repeated"])
    Oct(size=(DEPTH, 70, 1)).add("Intensity", LEVELS[0][:70]).write(folder / "s2.oct")
    assert "s2.oct differs from s1.oct; found 70 A-scans of 64 samples" in refused(folder)
    intensity().write(folder / "s2.oct")
    assert "holds more than one recording; found s2.oct, a volume of 5 B-scans" in refused(folder)


# damaged and hostile files


def small() -> bytes:
    rng = np.random.default_rng(1)
    made = Oct(size=(8, 70, 2)).add("Intensity", rng.normal(40, 5, (2, 70, 8)).astype(np.float32))
    return made.bytes(compression=zipfile.ZIP_DEFLATED)


def test_a_truncated_file_is_one_line_at_every_64th_byte(tmp_path: Path) -> None:
    data, path = small(), tmp_path / "scan.oct"
    for end in range(64, len(data), 64):
        path.write_bytes(data[:end])
        assert "truncated" in refused(path)


def test_one_bad_byte_is_read_or_one_line(tmp_path: Path) -> None:
    data, path, n_refused = small(), tmp_path / "scan.oct", 0
    for at in range(0, len(data), 29):
        path.write_bytes(data[:at] + bytes([data[at] ^ 0x55]) + data[at + 1 :])
        with suppress(EndoctError):
            frames(open_stack(path))
            continue
        n_refused += 1
    assert n_refused > len(data) // 29 * 0.9  # compressed members have their checksums held against them


def rezipped(header: bytes, members: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("Header.xml", header)
        for name, content in members.items():
            archive.writestr(name, content)
    return buffer.getvalue()


ENTITIES = '<!DOCTYPE a [<!ENTITY b "ha"><!ENTITY c "&b;&b;&b;">]><Ocity>&c;</Ocity>'
OUTSIDE = '<!DOCTYPE a SYSTEM "file:///etc/passwd"><Ocity/>'


@pytest.mark.parametrize(
    ("header", "said"),
    [
        (ENTITIES, "a document type"),
        (OUTSIDE, "a document type"),
        ("<Ocity>&c;</Ocity>", "no valid XML"),
        ("<Ocity>", "no valid XML"),
        ("<Ocity>" + "<a>" * 100 + "</a>" * 100 + "</Ocity>", "too many elements"),
        ('<?xml version="1.0" encoding="no-such"?><Ocity/>', "no valid XML"),
        ("<a><Ocity/></a>", "no header of a ThorImage file"),
    ],
)
def test_headers_that_are_none(header: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "scan.oct").write_bytes(rezipped(header.encode(), {}))
    assert said in refused(tmp_path / "scan.oct")


def changed(data: bytes, sign: bytes, place: int, value: int, name: bytes = b"Intensity") -> bytes:
    """The archive with a number of a record of the member ``name`` changed, in its list or before its bytes."""
    length = {b"PK\1\2": 46, b"PK\3\4": 30}[sign]
    at = data.index(name) - len("data\\") - length
    at = at if data[at : at + 4] == sign else data.rindex(name) - len("data\\") - length
    assert data[at : at + 4] == sign
    return data[: at + place] + struct.pack("<L", value) + data[at + place + 4 :]


@pytest.mark.parametrize(
    ("place", "value", "said"),
    [
        (24, 2240 * 450_000, "asks for too much memory"),  # of two B-scans of 2240 bytes
        (24, 4480 * 3, "does not have its stated size"),
        (24, 4480 // 2, "does not have its stated size; found more bytes"),
        (20, 10**9, "reaches beyond its end"),
        (16, 7, "another checksum"),
        (42, 7, "no header of a file"),
    ],
)
def test_lengths_that_lie(place: int, value: int, said: str, tmp_path: Path) -> None:
    (tmp_path / "scan.oct").write_bytes(changed(small(), b"PK\1\2", place, value))
    assert said in refused(tmp_path / "scan.oct")


def test_what_unpacks_to_far_more_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = Oct(size=(8, 70, 2)).add("Intensity", np.zeros((2, 70, 8), np.float32))
    bomb = zlib.compressobj(9, wbits=-15)
    packed = b"".join(bomb.compress(bytes(1 << 20)) for _ in range(64)) + bomb.flush()
    data = made.bytes(compression=zipfile.ZIP_DEFLATED)
    start = data.index(b"Intensity.data") + len("Intensity.data")
    n_before = struct.unpack_from("<L", data, data.rindex(b"data\\Intensity") - 46 + 20)[0]
    end = start + n_before
    moved = bytearray(data[:start] + packed + data[end:])
    by = len(packed) - n_before
    for name in (b"data\\Intensity", b"Header.xml"):
        at = bytes(moved).rindex(name) - 46
        field, value = (20, len(packed)) if name.startswith(b"data") else (42, None)
        old = struct.unpack_from("<L", moved, at + field)[0]
        struct.pack_into("<L", moved, at + field, value if value is not None else old + by)
    at = bytes(moved).rindex(b"PK\5\6")
    struct.pack_into("<L", moved, at + 16, struct.unpack_from("<L", moved, at + 16)[0] + by)
    (tmp_path / "scan.oct").write_bytes(moved)
    assert "does not have its stated size; found more bytes" in refused(tmp_path / "scan.oct")
    monkeypatch.setenv("ENDOCT_LARGEST_ARRAY_GB", "1e-6")
    assert "asks for too much memory" in refused(tmp_path / "scan.oct")


def test_a_header_that_is_a_bomb(tmp_path: Path) -> None:
    (tmp_path / "scan.oct").write_bytes(rezipped(b"<Ocity>" + b" " * 20_000_000 + b"</Ocity>", {}))
    assert "too large for what it should be" in refused(tmp_path / "scan.oct")


@pytest.mark.parametrize("name", ["../outside.data", "/etc/passwd", "C:\\x.data", "data/../../y"])
def test_names_of_members_are_no_paths(name: str, tmp_path: Path) -> None:
    made = Oct(size=(DEPTH, ASCANS, 1)).add("Intensity", LEVELS[0])
    header = made.header().replace("data\\Intensity.data", name).replace("ENCODING", "utf-8")
    (tmp_path / "scan.oct").write_bytes(rezipped(header.encode(), {name: bytes(100)}))
    assert "holds no B-scans that are read" in refused(tmp_path / "scan.oct")
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["scan.oct"]


def test_methods_that_are_not_read(tmp_path: Path) -> None:
    path = intensity().write(tmp_path / "scan.oct", compression=zipfile.ZIP_LZMA)
    assert "method 14 of compression; pack the archive again without compression" in refused(path)


def test_links_lead_to_files_alone(tmp_path: Path) -> None:
    intensity().write(tmp_path / "real.bin")
    (tmp_path / "scan.oct").symlink_to(tmp_path / "real.bin")
    assert len(open_stack(tmp_path / "scan.oct")) == SLICES
    for target in (Path("/dev/zero"), tmp_path / "nowhere"):
        (tmp_path / "other.oct").unlink(missing_ok=True)
        (tmp_path / "other.oct").symlink_to(target)
        refused(tmp_path / "other.oct")
