"""The landmarks of a comparison on the page, judged as `endoct compare` does, and notes: loaded from its session file,
and saved there.

The session file is the only thing that the page ever writes.
"""

import hashlib
import shlex
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from endoct.base.errors import EndoctError
from endoct.base.files.contents import whole_of
from endoct.base.files.files import SMALL_BYTES, read_small, sha256_of
from endoct.base.files.output import new_output
from endoct.fusion.doubts import doubts_by_hand
from endoct.fusion.files.session import (
    NAME,
    Identity,
    Session,
    check_sides,
    identity_of,
    note_json,
    object_from,
    pair_json,
    placed_from,
    recorded_identity,
    session_from,
)
from endoct.fusion.files.store import ComparisonOutline
from endoct.fusion.geometry.alignment import Alignment, LandmarkPair, Place, SearchOutcome, residuals_mm
from endoct.fusion.parameters import CompareParameters
from endoct.fusion.registration.align import orientations_of
from endoct.fusion.registration.by_hand import KnownBore, distance, distances, judge
from endoct.fusion.result import ByHand, PairDistance, Result
from endoct.stitching.store import PanoramaOutline, load_panorama
from endoct.workbench.page.presence import Gone, Origin

KIND = "session"
PLAIN = ("corrected-by-hand", "aligned-by-hand")
"""Doubts that say no more than that pairs correct."""
POSTED = "what the page sent"


@dataclass(frozen=True, eq=False)
class Sessions:
    """The session file of the comparison at ``origin``, and what landmark pairs are judged by.

    Attributes: ``names`` of the sides, ``outlines`` of their panoramas; ``automatic``, the alignment found without
    pairs, ``present`` the one that is shown, None where there is none; ``used``, pairs that have corrected it already;
    ``refused``, why there can be no session here, else "".
    """

    origin: Origin
    names: tuple[str, str]
    outlines: tuple[PanoramaOutline, PanoramaOutline]
    automatic: SearchOutcome
    present: Alignment | None
    used: tuple[LandmarkPair, ...]
    parameters: CompareParameters
    refused: str = ""
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    @property
    def folder(self) -> Path:
        """The folder of the comparison."""
        return self.origin.folder

    @property
    def path(self) -> Path:
        """Where the session file lies."""
        return self.folder / NAME

    @cached_property
    def identities(self) -> tuple[Identity, Identity]:
        """The two sides, as a session file has them."""
        stores = [self.folder / "panoramas" / f"{name}.zarr" for name in self.names]
        a, b = (
            recorded_identity(name, outline.provenance) or identity_of(name, load_panorama(store))
            for name, outline, store in zip(self.names, self.outlines, stores, strict=True)
        )
        return a, b

    def state(self, *, offline: bool = False) -> dict[str, Any]:
        """Return the session for the page: its notes and pairs, those that were used already where there is no file.

        ``saved`` is the digest of the file, None where there is none; ``refused`` says why nothing can be saved. What
        an ``offline`` page says holds wherever the folder lies: its paths are seen from within that.
        """
        session, saved, refused = Session(self.identities, self.used), None, self.refused
        if not refused:
            try:
                found = self._stored(self.folder)
                if found is not None:
                    session, saved = found
            except EndoctError as error:
                refused = f"{error}. Nothing can be saved while it is there."
        return {
            "sides": [vars(side) for side in self.identities],
            "pairs": [pair_json(pair) for pair in session.pairs],
            "notes": [note_json(note) for note in session.notes],
            "saved": saved,
            "refused": refused,
            "file": NAME if offline else str(self.path),
            "command": self.command(Path() if offline else self.folder),
            "judged": self.judged(session.pairs),
        }

    def judged(self, pairs: Sequence[LandmarkPair]) -> dict[str, Any]:
        """Return for the page how far ``pairs`` lie apart now, and what `endoct compare --session` would make of them.

        ``by_hand`` as in ``result.json``; null with ``error`` where they would be refused.
        """
        radius_mm = self.outlines[0].grid.radius_mm
        now = None if self.present is None or not pairs else residuals_mm(pairs, self.present, radius_mm)
        present: dict[str, Any] = {
            "each": [_json(distance(now, k)) for k in range(len(pairs))],
            "check": _json(distances(pairs, "check", now)),
        }
        scales = self.parameters.z_scale_min, self.parameters.z_scale_max
        try:
            judged = judge(pairs, self.automatic, KnownBore(radius_mm, orientations_of(*self.outlines), scales))
        except EndoctError as error:
            return {"present": present, "by_hand": None, "said": [], "error": str(error)}
        said = []
        if judged.outcome.alignment:
            doubts = doubts_by_hand(judged.said, judged.outcome.alignment, self.names[1], self.parameters)
            said = [doubt.what for doubt in doubts if doubt.code not in PLAIN]
        elif pairs:
            said = [judged.outcome.reason]
        return {"present": present, "by_hand": _json(judged.said), "said": said, "error": ""}

    def judged_from(self, data: bytes) -> dict[str, Any]:
        """Return as :meth:`judged` what is to be said of posted pairs.

        Raises :class:`EndoctError` for nonsense, and :class:`Gone` where the comparison is not there any more.
        """
        self.origin.check_present()
        return self.judged(placed_from(object_from(data, POSTED), POSTED)[0])

    def save(self, data: bytes) -> dict[str, Any]:
        """Write posted pairs and notes into the session file and return its digest as ``saved``.

        ``based_on`` in ``data`` is the digest of the file that the page had read, null where there was none. No other
        folder than the comparison's is written to. Raises :class:`EndoctError` for nonsense, and where the file is
        another by now, a link, or no session of these sides. Raises :class:`Gone` where the comparison is not there any
        more.
        """
        if self.refused:
            raise EndoctError(self.refused)
        posted = object_from(data, POSTED)
        based_on = posted.pop("based_on", None)
        session = Session(self.identities, *placed_from(posted, POSTED))
        content = session.to_bytes()
        session_from(content, POSTED)  # what is written can be read
        if len(content) > SMALL_BYTES:
            raise EndoctError("the session cannot be saved", expected=f"{SMALL_BYTES} bytes at most")
        with self._lock, self.origin.held() as folder:
            found = self._stored(folder)
            if (found and found[1]) != based_on:
                raise EndoctError(
                    f"{self.path} was changed meanwhile, by another window perhaps",
                    remedy="note what you placed and load the page anew",
                )
            with new_output(
                folder / NAME, KIND, overwrite=found is not None, is_ours=lambda path: sha256_of(path) == based_on
            ) as scratch:
                scratch.write_bytes(content)
            try:
                self.origin.check_present()
            except Gone:
                if found is None:  # the page says that nothing was saved
                    (folder / NAME).unlink(missing_ok=True)
                raise
        return {"saved": hashlib.sha256(content).hexdigest()}

    def command(self, folder: Path) -> str:
        """Return the command line that compares anew with the session file; ``folder``: the comparison's from there."""
        stores = [str(folder / "panoramas" / f"{name}.zarr") for name in self.names]
        chosen = self.parameters.model_dump(mode="json", exclude_defaults=True)
        texts = {key: str(value).lower() if isinstance(value, bool) else str(value) for key, value in chosen.items()}
        options = [part for key, text in texts.items() for part in ("--set", f"{key}={text}")]
        above = Path("..") if folder == Path() else folder.parent
        output = above / f"{self.folder.resolve().name}-by-hand"
        parts = ["endoct", "compare", *stores, "-o", str(output), "--session", str(folder / NAME), *options]
        return shlex.join(parts)

    def _stored(self, folder: Path) -> tuple[Session, str] | None:
        """Return the session in the file in ``folder`` and the file's digest; None where there is no file."""
        path = folder / NAME
        if path.is_symlink():
            raise EndoctError(f"{self.path} is a link", expected="a session file", remedy="move it away")
        if not path.exists():
            return None
        data = read_small(path, SMALL_BYTES)
        session = session_from(data, str(self.path))
        check_sides(session, self.identities, str(self.path))
        return session, hashlib.sha256(data).hexdigest()


def session_of(origin: Origin, outline: ComparisonOutline, sides: tuple[PanoramaOutline, PanoramaOutline]) -> Sessions:
    """Return what the page knows of landmarks on the comparison at ``origin`` of two ``sides``."""
    result, refused = outline.result, ""
    if (whole := whole_of(origin.folder)) is not None:
        lists = f"This is a part of {whole.name}, which lists all that it holds."
        refused = f"{lists} To place landmarks, copy this folder."
    used = () if result.by_hand is None else result.by_hand.pairs
    return Sessions(
        origin=origin,
        names=outline.names,
        outlines=sides,
        automatic=_automatic(outline),
        present=outline.alignment,
        used=tuple(LandmarkPair(_at(pair.a), _at(pair.b), pair.role, pair.name, pair.sigma_mm) for pair in used),
        parameters=_parameters(result),
        refused=refused,
    )


def _at(place: Any) -> Place:
    return Place(place.theta_rad, place.z_mm)


def _automatic(outline: ComparisonOutline) -> SearchOutcome:
    """Return the alignment that was found without pairs, or why there was none."""
    by_hand, result = outline.result.by_hand, outline.result
    if by_hand is None:
        best = None if result.best_unbelieved is None else result.best_unbelieved.to_alignment()
        return SearchOutcome(outline.alignment, best, result.reason or "")
    found = None if by_hand.automatic is None else by_hand.automatic.to_alignment()
    if by_hand.automatic_reason is None and found is not None:
        return SearchOutcome(found)
    return SearchOutcome(None, found, by_hand.automatic_reason or "")


def _parameters(result: Result) -> CompareParameters:
    """Return the parameters of the comparison as far as they are some; a result may come from another version."""
    stored = result.parameters.get("compare") or {}
    known = {key: value for key, value in stored.items() if key in CompareParameters.model_fields}
    try:
        return CompareParameters.model_validate(known)
    except ValueError:
        return CompareParameters()


def _json(part: ByHand | PairDistance | Any | None) -> Any:
    return None if part is None else part.model_dump(mode="json")
