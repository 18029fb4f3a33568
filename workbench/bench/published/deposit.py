"""What goes with a published set when it is uploaded: description, licence, citation, data card, pictures, Croissant.

Croissant describes data sets to machines (Akhtar et al. 2024, https://docs.mlcommons.org/croissant/). Its RAI fields
say how the data came about, what they are for and what they lack.
"""

import csv
import io
import json
from importlib.resources import files
from pathlib import Path
from string import Template

from endoct.base.files.files import sha256_of
from endoct.base.files.scratch import keep_aside, new_file
from endoct.workbench.bench.published.card import pictures, walls_of_kinds
from endoct.workbench.bench.published.definition import Definition, load_definition
from endoct.workbench.bench.published.specimen_set import SET_FILE, SpecimenSet

TABLE, CROISSANT = "specimens.csv", "croissant.json"
LICENCE_URL = "https://creativecommons.org/licenses/by/4.0/"
TEXTS = ("README.md", "LICENSE", "CITATION.cff", "deposit.md")
COLUMNS = "name", "generator", "difficulty", "split", "tasks", "digest"
"""Of the table; ``templates/croissant.json`` says what they are."""


def write_deposit(folder: Path, listed: SpecimenSet) -> None:
    """Write into a set's folder what goes with it; none of it is part of a digest."""
    _write(folder / TABLE, _table(listed).encode())
    for name, picture in pictures(folder, listed):
        (folder / name).parent.mkdir(exist_ok=True)
        _write(folder / name, picture)
    values = _values(load_definition(listed.set), listed) | {"kinds": walls_of_kinds(folder, listed)}
    values |= {"set_sha256": sha256_of(folder / SET_FILE), "table_sha256": sha256_of(folder / TABLE)}
    quoted = {name: json.dumps(value, ensure_ascii=False)[1:-1] for name, value in values.items()}
    for name in (*TEXTS, CROISSANT):
        template = Template(files(f"{__package__}.templates").joinpath(name).read_text("utf-8"))
        _write(folder / name, template.substitute(quoted if name == CROISSANT else values).encode())


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
        "digest": listed.digest,
        "endoct": listed.versions.get("endoct", "–"),
        "simulator": definition.simulator,
        "licence_url": LICENCE_URL,
    }


def _write(path: Path, content: bytes) -> None:
    """Write a file; one of that name with other content, perhaps a person's, is kept next to it."""
    if path.is_file():
        if path.read_bytes() == content:
            return
        keep_aside(path, path)
    with new_file(path) as file:
        file.write(content)
