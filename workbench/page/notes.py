"""What a person notes on a result: a text file in its folder, which is the user's own."""

from pathlib import Path

from endoct.base.errors import EndoctError
from endoct.base.files.contents import whole_of
from endoct.base.files.files import read_small
from endoct.base.files.output import new_output

NAME = "endoct-note.txt"
MOST_CHARACTERS = 20_000
MOST_BYTES = 4 * MOST_CHARACTERS


def read_note(folder: Path) -> str:
    """Return the note on the result in ``folder``, "" where there is none, or no text of ours."""
    path = folder / NAME
    if path.is_symlink() or not path.is_file():
        return ""
    try:
        return read_small(path, MOST_BYTES).decode("utf-8")
    except (EndoctError, UnicodeDecodeError):
        return ""


def write_note(folder: Path, text: object, was: object) -> str:
    """Write the note on the result in ``folder``, without one where the ``text`` is empty, and return it.

    ``was`` is the note as whoever writes has read it. Raises :class:`EndoctError` for what is no text or too long,
    where the note is another by now or no text of ours, and where the result is a part of another.
    """
    lines = text.replace("\r\n", "\n").strip().split("\n") if isinstance(text, str) else ["\0"]
    if not all(line.replace("\t", " ").isprintable() for line in lines) or sum(map(len, lines)) > MOST_CHARACTERS:
        raise EndoctError("the note cannot be saved", expected=f"text, {MOST_CHARACTERS} characters at most")
    path, note = folder / NAME, "\n".join(lines)
    if path.is_symlink() or (path.exists() and not read_note(folder)):
        raise EndoctError(f"{path} is no note", remedy="move it away")
    if read_note(folder) != was:
        raise EndoctError(f"{path} was changed meanwhile, by another window perhaps", remedy="load the page anew")
    if (whole := whole_of(folder)) is not None:
        raise EndoctError(f"{folder} is a part of {whole.name}", remedy="note it there")
    if not note:
        path.unlink(missing_ok=True)
        return ""
    with new_output(path, "note", overwrite=path.exists(), is_ours=lambda _: read_note(folder) == was) as scratch:
        scratch.write_text(note, encoding="utf-8")
    return note
