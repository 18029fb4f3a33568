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
    if (tube := sample.bore.tube) is not None:  # what is to be measured is not stated, or roughly
        capillary_mm = oct_.capillary_outer_diameter_mm + tube.capillary_error * tube.sigma_capillary_mm
        return keys | {
            "axial_pixel_mm": oct_.axial_pixel_mm * tube.axial_pixel_factor,
            "pullback_pitch_mm": PRESETS[sample.preset].pitch_mm * tube.pitch_factor,
            "capillary_outer_diameter_mm": capillary_mm,
            "handedness": "unknown",
            "standard_errors": {"capillary_outer_diameter_mm": tube.sigma_capillary_mm},
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
    if sample.bore.tube is not None:  # of an endoscope that is to be calibrated, nothing is known
        del keys["visible_length_mm"], keys["outer_rim"]
        return keys
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


def tube_file(sample: Sample) -> dict[str, TomlValue]:
    """Return the keys of ``tube.toml``: what is stated of a printed tube; none for bone."""
    bore, tube = sample.bore, sample.bore.tube
    if tube is None:
        return {}
    return {
        "bore_diameter_mm": bore.diameter_mm,
        "outer_diameter_mm": bore.diameter_mm + 3.2,
        "length_mm": bore.length_mm,
        "groove_width_mm": tube.groove_width_mm,
        "helix_width_mm": tube.helix_width_mm,
        "groove_depth_mm": tube.groove_depth_mm,
        "helix_theta_rad": tube.helix_theta_rad,
        "helix_lead_mm": tube.helix_lead_mm,
        "ring_z_mm": [tube.narrow_z_mm, tube.wide_z_mm],
        "ring_width_mm": [tube.narrow_width_mm, tube.wide_width_mm],
        "ring_depth_mm": tube.ring_depth_mm,
        "standard_errors": {
            "bore_diameter_mm": tube.sigma_bore_mm,
            "depth_mm": tube.sigma_depth_mm,
            "z_mm": tube.sigma_z_mm,
        },
    }


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
