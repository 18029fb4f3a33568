"""The figures of a report as PDF and as SVG."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree
from zipfile import ZipFile

import pytest
from workbench_page import written

from endoct.base.errors import EndoctError
from endoct.workbench import export
from endoct.workbench.exporting.figure_files import write_pdf
from endoct.workbench.exporting.source import open_for_export
from endoct.workbench.requests import ExportRequest
from endoct.workbench.running.progress import SilentStages

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The figures of a comparison as SVG."""
    folder = tmp_path_factory.mktemp("figures")
    export(written(folder / "result"), folder / "figures.svg.zip")
    return folder / "figures.svg.zip"


def test_every_figure_is_a_drawing_whose_text_can_be_edited(drawn: Path):
    with ZipFile(drawn) as archive:
        names = [name.removesuffix(".svg") for name in archive.namelist() if name.endswith(".svg")]
        captions = archive.read("captions.txt").decode()
        root = ElementTree.fromstring(archive.read("panoramas.svg"))
    assert {"panoramas", "masks", "alignment"} <= set(names)
    assert all(f"{name}.svg: " in captions for name in names)
    texts = {text.text for text in root.iter(f"{SVG}text")}
    assert {"(a) endoscope", "θ (°)"} <= texts
    width, height = (float(root.attrib[side].removesuffix("pt")) for side in ("width", "height"))
    assert 300 < width < 7.2 * 72 + 72  # a page's width, without the paper around it
    assert 150 < height < width


def test_the_same_figures_give_the_same_bytes(drawn: Path, tmp_path: Path):
    result = drawn.parent / "result"
    export(result, tmp_path / "once.svg.zip")
    assert (tmp_path / "once.svg.zip").read_bytes() == drawn.read_bytes()


def test_a_pdf_has_a_page_for_every_figure(drawn: Path, tmp_path: Path):
    exported = export(drawn.parent / "result", tmp_path / "figures.pdf")
    with ZipFile(drawn) as archive:
        n = len(archive.namelist()) - 1
    data = (tmp_path / "figures.pdf").read_bytes()
    assert exported.facts["figures"] == n
    assert data.startswith(b"%PDF-")
    assert data.count(b"/Type /Page ") == n
    assert b"CreationDate" not in data


def test_a_truth_has_no_figures(drawn: Path, tmp_path: Path):
    truth = replace(open_for_export(drawn.parent / "result"), kind="truth")
    with pytest.raises(EndoctError, match="has no figures"):
        write_pdf(truth, tmp_path / "x.pdf", ExportRequest("", ""), SilentStages())
