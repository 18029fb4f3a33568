"""KEY=VALUE settings of a side: keys of its sidecar and of its processing parameters, by one list of names."""

import tomllib
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from endoct.modalities.acquisition import validate
from endoct.modalities.contract import Manifest
from endoct.stitching.errors import EndoctError, cause_of


def parse(settings: tuple[str, ...]) -> dict[str, object]:
    """Read ``("undistort=sine", "axial_pixel_mm=0.005")``; values are TOML, or else plain words."""
    values: dict[str, object] = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not key.strip():
            raise EndoctError("a setting cannot be read", found=f"'{setting}'", expected="KEY=VALUE")
        try:
            values[key.strip()] = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            values[key.strip()] = text
        except (ValueError, RecursionError) as error:  # a number of thousands of digits, brackets in brackets
            raise EndoctError(
                f"the value of '{key.strip()[:80]}' cannot be read", found=cause_of(error), expected="a plain value"
            ) from error
    return values


def split(settings: Mapping[str, object], manifest: Manifest) -> tuple[dict[str, object], Any]:
    """Return (keys that override the sidecar, the plug-in's parameters).

    Raises :class:`EndoctError` for a key that neither has (suggesting the nearest) or an impossible value.
    """
    sidecar_keys = manifest.acquisition.model_fields
    model: type[BaseModel] = manifest.load().parameters
    overrides = {key: value for key, value in settings.items() if key.partition(".")[0] in sidecar_keys}
    chosen = {key: value for key, value in settings.items() if key not in overrides}
    return overrides, validate(model, chosen, f"the settings of '{manifest.name}'", also=tuple(sidecar_keys))
