"""The page of a pose: what it says of the sides, of structures and of what was read; no text leaves its place."""

import re
from dataclasses import replace

from endoct.base.doubt import Doubt
from endoct.workbench.posing.pages import pose_page
from endoct.workbench.posing.result import PoseResult

HOSTILE = "</title>\"'><script>alert(1)</script>&{{ 7 * 7 }}\x1b[31m\u202e\udce9"


def sections_of(page: str) -> list[str]:
    return re.findall(r'<details class="section" id="([^"]*)" open>', page)


def test_what_is_not_known_has_no_section(by_camera: PoseResult, found: PoseResult) -> None:
    assert sections_of(pose_page(by_camera, "one", [])) == ["plan", "sides", "volumes", "provenance"]
    page = pose_page(found, "two", [])
    assert sections_of(page) == ["plan", "structures", "sides", "difference", "volumes", "provenance"]
    assert "The axis by ranger alone less that by camera alone." in page
    assert "which is not told" not in page
    untold = replace(found, answer=replace(found.answer, reason="Nothing stands out."))
    assert pose_page(untold, "none", []).count("<p>Of the best pose there is, which is not told.</p>") == 2


def test_no_text_leaves_its_place(found: PoseResult) -> None:
    facts = replace(
        found.volumes["ct"],
        title=HOSTILE,
        facts={HOSTILE: [HOSTILE]},
        notes=(HOSTILE,),
        doubts=(Doubt("odd", HOSTILE),),
    )
    made = replace(found.made, inputs={HOSTILE: HOSTILE}, versions={HOSTILE: HOSTILE, "endoct": HOSTILE})
    clearances = tuple(replace(one, name=HOSTILE) for one in found.summary.clearances)
    summary = replace(found.summary, clearances=clearances)
    page = pose_page(replace(found, volumes={"ct": facts}, made=made, summary=summary), HOSTILE, [])
    said = page.partition("</style>")[2]
    assert "<script" not in said
    assert said.count("&lt;script&gt;alert(1)&lt;/script&gt;") >= 13
    assert said.count("{{ 7 * 7 }}") == said.count("&lt;script&gt;")
    assert said.replace("\n", "").isprintable()
