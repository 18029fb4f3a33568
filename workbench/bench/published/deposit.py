"""What goes with a published set when it is uploaded: description, licence, citation, data card and Croissant.

Croissant describes data sets to machines (Akhtar et al. 2024, https://docs.mlcommons.org/croissant/). Its RAI fields
say how the data came about, what they are for and what they lack.
"""

import csv
import io
import json
from collections import Counter
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from string import Template

from endoct.base.files.files import sha256_of
from endoct.base.files.scratch import keep_aside, new_file
from endoct.workbench.bench.published.definition import Definition, load_definition
from endoct.workbench.bench.published.specimen_set import SET_FILE, SpecimenSet

TABLE, CROISSANT = "specimens.csv", "croissant.json"
LICENCE_URL = "https://creativecommons.org/licenses/by/4.0/"
TEXTS = ("README.md", "LICENSE", "CITATION.cff", "deposit.md")
COLUMNS: Mapping[str, str] = {
    "name": "The folder of the specimen.",
    "generator": "Who made it: endoct's simulator, or the second generator, which shares no code with endoct.",
    "difficulty": "easy, middle or hard.",
    "split": "train, or test: what methods are scored on.",
    "tasks": "The tasks that the specimen is for, separated by spaces.",
    "digest": "sha256 of the digests of its recordings, truth and panoramas, as set.json lists them.",
}
RAI: Mapping[str, str | list[str]] = {
    "rai:dataCollection": "Simulated: a renderer draws a drill hole in bone, and what an endoscope with a cone mirror "
    "and a rotating catheter OCT record of it. Half of the specimens are made by a second renderer, written apart, "
    "with other models of bone, light, speckle and refraction. No patient and no animal is in the data.",
    "rai:dataCollectionType": "Simulations",
    "rai:dataPreprocessingProtocol": "Panoramas (.zarr) are unrolled from the recordings by endoct, whose version and "
    "parameters each store states.",
    "rai:dataAnnotationProtocol": "None by hand: the truth is what was simulated.",
    "rai:dataBiases": "Cells, textures, noise and motion follow chosen distributions, listed in truth/sample.json. "
    "Real instruments differ. A method that wins here has to be tried on real recordings.",
    "rai:dataLimitations": "Bores of 2.2 to 2.8 mm; no blood, no moving tissue, no tool in the hole. Not to be used to "
    "judge the safety of an operation.",
    "rai:dataUseCases": [
        "Comparing methods of unrolling, stitching, segmentation, alignment and pose of bores",
        "Training of such methods; the hidden half is for testing",
    ],
    "rai:dataSocialImpact": "Minimally invasive surgery of the ear may become easier to verify. A figure on simulated "
    "data says nothing of a patient.",
    "rai:personalSensitiveInformation": "None.",
    "rai:dataReleaseMaintenancePlan": "Frozen. Errors are listed in the data card; a mended set gets another name.",
}
CONTEXT: Mapping[str, object] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
"""That of Croissant 1.0, as its specification gives it."""


def write_deposit(folder: Path, listed: SpecimenSet) -> None:
    """Write into a set's folder what goes with it; none of it is part of a digest."""
    definition = load_definition(listed.set)
    _write(folder / TABLE, _table(listed))
    values = _values(definition, listed)
    for name in TEXTS:
        template = files(f"{__package__}.templates").joinpath(name).read_text("utf-8")
        _write(folder / name, Template(template).substitute(values))
    _write(folder / CROISSANT, json.dumps(croissant(folder, definition, listed), indent=1, ensure_ascii=False) + "\n")


def croissant(folder: Path, definition: Definition, listed: SpecimenSet) -> dict[str, object]:
    """Return the Croissant description of a set whose ``set.json`` and table are written."""
    values = _values(definition, listed)
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": ["http://mlcommons.org/croissant/1.0", "http://mlcommons.org/croissant/RAI/1.0"],
        "name": values["name"],
        "description": values["description"],
        "license": LICENCE_URL,
        "version": "1.0.0",
        "datePublished": "2026-11-27",
        "creator": {"@type": "sc:Organization", "name": "The endoct developers"},
        "keywords": ["optical coherence tomography", "endoscopy", "temporal bone", "stitching", "registration"],
        "citeAs": f"The endoct developers. {values['name']}: {definition.title}. 2026.",
        "isLiveDataset": False,
        **RAI,
        "distribution": [_file(folder, SET_FILE, "application/json"), _file(folder, TABLE, "text/csv")],
        "recordSet": [
            {
                "@type": "cr:RecordSet",
                "@id": "specimens",
                "name": "specimens",
                "description": "A record a specimen; its folder has the recordings, their panoramas and the truth.",
                "key": {"@id": "specimens/name"},
                "field": [_field(name, text) for name, text in COLUMNS.items()],
            }
        ],
    }


def _file(folder: Path, name: str, encoding: str) -> dict[str, object]:
    return {
        "@type": "cr:FileObject",
        "@id": name,
        "name": name,
        "contentUrl": name,
        "encodingFormat": encoding,
        "sha256": sha256_of(folder / name),
    }


def _field(name: str, text: str) -> dict[str, object]:
    return {
        "@type": "cr:Field",
        "@id": f"specimens/{name}",
        "name": name,
        "description": text,
        "dataType": "sc:Text",
        "source": {"fileObject": {"@id": TABLE}, "extract": {"column": name}},
    }


def _table(listed: SpecimenSet) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for one in listed.specimens:
        writer.writerow([one.name, one.generator, one.difficulty, one.split, " ".join(one.tasks), one.digest])
    return text.getvalue()


def _values(definition: Definition, listed: SpecimenSet) -> dict[str, str]:
    """Return what the templates of the texts name."""
    name = f"{definition.name}-{listed.half}-{listed.size}"
    kinds = Counter((one.generator, one.difficulty, " ".join(one.tasks)) for one in listed.specimens)
    tasks = "\n".join(
        f"| `{task}` | {scored.title} | {scored.score}, {scored.better} is better |"
        for task, scored in definition.tasks.items()
    )
    return {
        "name": name,
        "set": definition.name,
        "title": definition.title,
        "half": listed.half,
        "size": listed.size,
        "n": str(len(listed.specimens)),
        "description": f"{definition.title}: {len(listed.specimens)} simulated specimens with truth, from two "
        f"generators that share no code, in three difficulties, for the tasks {', '.join(definition.tasks)}.",
        "tasks": tasks,
        "kinds": "\n".join(f"| {g} | {d} | {t} | {n} |" for (g, d, t), n in kinds.items()),
        "digest": listed.digest,
        "endoct": listed.versions.get("endoct", "–"),
        "simulator": definition.simulator,
        "licence_url": LICENCE_URL,
    }


def _write(path: Path, text: str) -> None:
    """Write a text; one of that name that says something else, perhaps a person's, is kept next to it."""
    if path.is_file():
        if path.read_bytes() == text.encode():
            return
        keep_aside(path, path)
    with new_file(path) as file:
        file.write(text.encode())
