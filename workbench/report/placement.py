"""Where one side lies in the frame of the other, in words."""

import math
from collections.abc import Iterator

import numpy as np

from endoct.fusion.result import StoredAlignment
from endoct.workbench.report.wording import NOTHING, area_text, length_text, share_text, value_text


def alignment_rows(alignment: StoredAlignment, *, by_hand: bool = False) -> Iterator[tuple[str, str]]:
    """Yield what there is to say of an alignment, [in words, value]; errors are standard errors.

    One that was made ``by_hand`` stands out from nothing: no search led to it.
    """
    turn, shift, scale = _standard_errors(alignment)
    yield "Turned by", f"{math.degrees(alignment.theta_shift_rad):.2f}°{turn}"
    yield "Shifted along the bore by", length_text(alignment.z_shift_mm) + shift
    yield "Scaled along the bore by", f"{alignment.z_scale:.4f}{scale}"
    yield "Mirrored in θ", value_text("mirrored", alignment.mirrored)
    yield "Reversed in z", value_text("z_reversed", alignment.z_reversed)
    if by_hand:
        yield "Correlation of what shows the cells", share_text(alignment.correlation)
        yield "Area that both observed", area_text(alignment.overlap_mm2)
        return
    yield "Confidence", share_text(alignment.confidence)
    yield "Correlation of what shows the cells", share_text(alignment.correlation)
    yield "Score over that of the next best place", _number(alignment.ratio)
    yield "Probability that chance gives as much", _number(alignment.chance)
    yield "Area that both observed", area_text(alignment.overlap_mm2)
    yield "Left uncorrected: departure from that turn around θ, up to", _degrees(alignment.uneven_rad, "°")
    yield "Left uncorrected: turn that grows along the bore", _degrees(alignment.twist_rad_per_mm, "° per mm")


def _standard_errors(alignment: StoredAlignment) -> tuple[str, str, str]:
    """Return " ± 0.28°", " ± 0.013 mm" and " ± 0.0028"; empty where they are not known."""
    if alignment.covariance is None:
        return "", "", ""
    variances = np.diag(alignment.covariance)
    if (variances < 0).any():
        return "", "", ""
    turn, shift, scale = (float(value) for value in np.sqrt(variances))
    return f" ± {math.degrees(turn):.2f}°", f" ± {length_text(shift)}", f" ± {scale:.4f}"


def _degrees(value_rad: float | None, unit: str) -> str:
    return NOTHING if value_rad is None else f"{math.degrees(value_rad):.2f}{unit}".replace("-", "−")


def _number(value: float | None) -> str:
    return NOTHING if value is None else f"{value:.3g}".replace("-", "−")
