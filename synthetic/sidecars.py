"""What the operator would have written down: the sidecars of both recordings."""

from collections.abc import Mapping

from endoct.synthetic.oct.bscan import CHIRP, OFFSET, SAMPLES
from endoct.synthetic.sample.parameters import Sample
from endoct.synthetic.sample.presets import PRESETS

TomlValue = str | float | list[float] | Mapping[str, str | float]


def oct_sidecar(sample: Sample) -> dict[str, TomlValue]:
    """Return the keys of ``oct/acquisition.toml``; what the operator does not know is left out or "unknown"."""
    oct_ = sample.oct
    keys: dict[str, TomlValue] = {
        "modality": "oct",
        "axial_pixel_mm": oct_.axial_pixel_mm,
        "pullback_pitch_mm": PRESETS[sample.preset].pitch_mm,
        "bore_diameter_mm": sample.bore.diameter_mm,
        "capillary_outer_diameter_mm": oct_.capillary_outer_diameter_mm,
        "travel": oct_.stated_travel,
        "handedness": ("same" if oct_.sense > 0 else "mirrored") if oct_.states_handedness else "unknown",
        "intensity": "log",
        "db_per_count": oct_.db_per_count,
        "scan": oct_.scan,
        "medium_index": 1.0,
    }
    if oct_.states_first_sample:
        keys["first_sample_mm"] = oct_.first_sample_mm
    return keys


def spectra_sidecar(sample: Sample) -> dict[str, TomlValue]:
    """Return the keys of ``oct-spectra/acquisition.toml``: in place of what is said of B-scans, of raw spectra."""
    size = PRESETS[sample.preset]
    keys = {key: value for key, value in oct_sidecar(sample).items() if key not in ("intensity", "db_per_count")}
    keys["spectra"] = {
        "file": SAMPLES,
        "samples": 2 * size.n_depth,
        "ascans": size.n_ascans,
        "chirp": CHIRP,
        "offset": OFFSET,
        "electrons_per_count": sample.oct.electrons_per_count,
    }
    return keys


def endoscope_sidecar(sample: Sample) -> dict[str, TomlValue]:
    """Return the keys of ``endoscope/acquisition.toml``."""
    camera = sample.endoscope
    keys: dict[str, TomlValue] = {
        "modality": "endoscope",
        "bore_diameter_mm": sample.bore.diameter_mm,
        "feed_pitch_mm": PRESETS[sample.preset].pitch_mm,
        "visible_length_mm": camera.visible_length_mm,
        "outer_rim": "ahead",
        "travel": camera.stated_travel,
    }
    if camera.states_optics:
        keys |= {
            "cone_half_angle_deg": camera.half_angle_deg,
            "focal_px": camera.focal_px,
            "mirror_distance_mm": camera.mirror_distance_mm,
            "distortion": [camera.distortion_k1],
        }
    if camera.states_annulus:
        x, y = camera.centre_px[0]
        keys["annulus"] = {"x": x, "y": y, "inner_px": camera.inner_px, "outer_px": camera.outer_px}
    return keys


def toml(keys: Mapping[str, TomlValue]) -> str:
    """Return ``keys`` (text, numbers, lists and flat tables of these) as TOML, rounded to 6 decimals."""
    return "".join(f"{key} = {_value(value)}\n" for key, value in keys.items())


def _value(value: TomlValue) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_value(inner)}" for key, inner in value.items()) + " }"
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list):
        return "[" + ", ".join(_value(inner) for inner in value) + "]"
    return repr(round(value, 6))
