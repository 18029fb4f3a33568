"""Readers of what people made by hand: sessions, and masks that were kept."""

from pathlib import Path


def try_session(path: Path) -> None:
    """Read a session file, and make its bytes again."""
    from endoct.fusion.files.session import check_sides, read_session

    session = read_session(path)
    check_sides(session, session.sides, str(path))
    session.to_bytes()


def try_drawn(path: Path) -> None:
    """Read the masks that `endoct compare` keeps."""
    from endoct.base.zarr.window import ChunkCache, stored_image
    from endoct.fusion.files.masks import DRAWN_STORE, read_drawn

    if (drawn := read_drawn(path)) is None:
        return
    for k in range(len(drawn.drawn_by)):
        for part in ("mask", "valid"):
            image = stored_image(path / DRAWN_STORE / part, ChunkCache(), (k,))
            image.read(slice(0, image.shape[0]), slice(0, image.shape[1]))
