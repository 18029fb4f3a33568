"""Pictures of single frames as the page has them: coded for a browser, with curves, and where a place lies in them."""

import base64
import io
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow

from endoct.modalities.contract import Picture, Seen
from endoct.stitching.store import PanoramaOutline

QUALITY = 92
"""Of a JPEG. WebP of quality 88 makes B-scans a fifth smaller and 0.5 to 1 dB better, in twenty times the time."""
MOST_POINTS = 1000
"""Of a curve: as many as a picture has columns."""


def picture_json(picture: Picture, ring: dict[str, float] | None) -> dict[str, Any]:
    """Return ``picture`` for the page.

    ``seen`` says where places of the wall are seen in it: ``x`` and ``y``, (n_z, n_theta), at ``z_mm`` and even steps
    of θ, None where not; None as a whole where the plug-in does not say. ``axis`` says how θ is found in it else:
    "theta", along x, or "ring": on the ``ring``, a line from its inner to its outer circle; None: nowhere.
    """
    is_ring = ring is not None and picture.x_label.endswith("(px)") and picture.y_label.endswith("(px)")
    axis = "ring" if is_ring else "theta" if picture.x_label.startswith("θ") else None
    every = {label: max(1, -(-len(curve) // MOST_POINTS)) for label, curve in picture.curves.items()}
    return {
        "title": picture.title,
        "about": picture.about,
        "x_label": picture.x_label,
        "y_label": picture.y_label,
        "x_extent": picture.x_extent,
        "y_extent": picture.y_extent,
        "curves": {label: _points(curve[:: every[label]]) for label, curve in picture.curves.items()},
        "seen": _seen(picture.seen),
        "axis": axis,
        "ring": ring if is_ring else None,
        "image": f"data:image/jpeg;base64,{base64.b64encode(_jpeg(picture.image)).decode('ascii')}",
    }


def ring_of(outline: PanoramaOutline, place: int) -> dict[str, float] | None:
    """Return the mirror's ring in the frame at ``place``, px, and its roll; None where the panorama does not say.

    θ on the wall is the angle in the image plus ``roll_rad``.
    """
    names = {
        **{"inner_x": "annulus_inner_x_px", "inner_y": "annulus_inner_y_px", "inner": "annulus_inner_px"},
        **{"outer_x": "annulus_x_px", "outer_y": "annulus_y_px", "outer": "annulus_outer_px"},
        "roll_rad": "roll_rad",
    }
    found = {key: outline.per_frame.get(name) for key, name in names.items()}
    values = {
        key: float(one.values[place]) for key, one in found.items() if one is not None and place < len(one.values)
    }
    return values if len(values) == len(names) and np.isfinite(list(values.values())).all() else None


def _points(curve: NDArray[np.float64]) -> Sequence[Sequence[float | None]]:
    known = np.isfinite(curve)
    places = zip(known[:, 0] & known[:, 1], curve.tolist(), strict=True)
    return [[float(f"{x:.5g}"), float(f"{y:.5g}")] if good else [None, None] for good, (x, y) in places]


def _seen(seen: Seen | None) -> dict[str, Any] | None:
    if seen is None:
        return None
    x, y = ([[_known(value) for value in row] for row in seen.xy[..., k].tolist()] for k in (0, 1))
    return {"z_mm": [round(z_mm, 6) for z_mm in seen.z_mm.tolist()], "x": x, "y": y}


def _known(value: float) -> float | None:
    return float(f"{value:.5g}") if math.isfinite(value) else None


def _jpeg(image: NDArray[Any]) -> bytes:
    """Return an image in grey or colours: of 8 bits as it is, others from the 0.2nd to the 99.8th percentile."""
    if image.dtype != np.uint8:
        known = image[np.isfinite(image)].astype(np.float32)
        low, high = np.percentile(known, [0.2, 99.8]) if known.size else (0.0, 1.0)
        scaled = (np.nan_to_num(image.astype(np.float32), nan=float(low)) - low) / max(float(high - low), 1e-9)
        image = np.clip(255 * scaled, 0, 255).astype(np.uint8)
    file = io.BytesIO()
    Pillow.fromarray(image).save(file, "JPEG", quality=QUALITY, subsampling="4:4:4")
    return file.getvalue()
