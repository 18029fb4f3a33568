"""Feed and roll by a method that was chosen by name, next to our own."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from endoct.base.arrays import Coordinates, Image
from endoct.base.doubt import Doubt
from endoct.base.entry_points import answer_by
from endoct.base.errors import EndoctError
from endoct.modalities.endoscope.mirror.band import Band
from endoct.modalities.endoscope.motion import Motion
from endoct.stitching.motion.feed import Feed
from endoct.stitching.strip import Strip


def by_method(
    motion: Motion, name: str, textures: Sequence[Image], band: Band, nominal: Coordinates | None
) -> tuple[Motion, Doubt]:
    """Return ``motion`` with the feed and roll of the method ``name``, and the doubt which says that they are its own.

    The method gets what methods of `endoct bench stitching` get: the strips of even light, and the nominal pitch. What
    our own motion says of the optics stays, since a method does not measure it. ``textures`` are the logarithms of
    strips on the rows of ``band``. Raises :class:`EndoctError` where there is no nominal feed or no such method, it
    fails, or answers something else than a place and a roll of every strip.
    """
    if nominal is None:
        raise EndoctError(
            f"the stitching method '{name}' needs the nominal feed",
            found="neither feed_pitch_mm nor positions_mm in the sidecar",
            remedy="add feed_pitch_mm to the sidecar, or leave feed_method out",
        )
    pitch_mm = band.optics.rim_sign * float(np.median(np.diff(nominal))) if nominal.size > 1 else 0.0
    strips = [_strip(texture, band) for texture in textures]
    feed = _checked(answer_by("stitching", name, strips, pitch_mm, setting="feed_method"), motion.feed, name)
    apart_mm = float(np.abs((feed.z_mm - feed.z_mm.mean()) - (motion.feed.z_mm - motion.feed.z_mm.mean())).max())
    what = (
        f"Feed and roll are those of the method '{name}'; endoct does not judge how far they can be trusted. Its own "
        f"feed has frames up to {apart_mm:.2f} mm elsewhere."
    )
    return replace(motion, feed=feed), Doubt("feed-by-method", what, value=apart_mm, unit="mm", expected=0.0)


def _strip(texture: Image, band: Band) -> Strip:
    """Return a logarithm of even light as the strip that a method of the bench gets: z from the middle of its band."""
    valid, n_theta = np.isfinite(texture), texture.shape[1]
    return Strip(
        z_mm=band.outward_mm,
        theta_rad=2 * np.pi / n_theta * np.arange(n_theta),
        intensity=np.exp(np.where(valid, texture, np.float32(0))),
        depth_mm=None,
        valid=valid,
        weight=valid.astype(np.float32),
    )


def _checked(answer: object, ours: Feed, name: str) -> Feed:
    """Return ``ours`` with the places that a method answers. What it says nothing of is not known."""
    parts = [np.asarray(getattr(answer, part, None)) for part in ("z_mm", "roll_rad", "trusted")]
    z_mm, roll_rad, trusted = parts
    n = ours.z_mm.size
    numbers = z_mm.dtype.kind == roll_rad.dtype.kind == "f" and trusted.dtype == np.bool_
    if not numbers or any(part.shape != (n,) for part in parts) or not np.isfinite([z_mm, roll_rad]).all():
        raise EndoctError(
            f"the stitching method '{name}' answers no places",
            found=", ".join(f"{part.dtype} {part.shape}" for part in parts)[:200],
            expected=f"z_mm and roll_rad, finite, and trusted, bool, each ({n},)",
        )
    unknown = np.full(n, np.nan)
    return replace(
        ours,
        z_mm=z_mm.astype(np.float64),
        roll_rad=roll_rad.astype(np.float64),
        sway_rad=np.zeros((n, 2)),
        confidence=unknown,
        correlation=unknown,
        trusted=trusted | (np.arange(n) == 0),
        measured=bool(trusted[1:].any()),
    )
