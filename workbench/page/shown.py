"""What one page shows: its description, and the layers that tiles are cut from."""

from collections.abc import Mapping
from dataclasses import dataclass

from endoct.workbench.page.description import Description
from endoct.workbench.page.layer import Classes, Layer, Scalar
from endoct.workbench.page.outlines import outlines
from endoct.workbench.page.wall import NoSuchTile, Tile, Wall


@dataclass(frozen=True, eq=False)
class Shown:
    """A comparison, or a panorama, opened for the page; ``layers`` by key."""

    description: Description
    wall: Wall
    layers: Mapping[str, Layer]

    def png(self, key: str, tile: Tile) -> bytes:
        """Return a tile of the layer ``key`` as PNG. Raises :class:`NoSuchTile` where there is no such tile."""
        finest = {layer.key: layer.finest_level for layer in self.description.layers}
        if key not in self.layers:
            raise NoSuchTile("there is no such layer", found=key, expected=", ".join(self.layers))
        if tile.level > finest[key]:
            raise NoSuchTile("there is no such tile", found=f"level {tile.level}", expected=f"{finest[key]} at most")
        return self.layers[key].png(self.wall, tile)

    def outlines(self) -> dict[str, tuple[tuple[float, ...], ...]]:
        """Return the outlines of cells by layer, as :func:`~endoct.workbench.page.outlines.outlines` has them."""
        parts = [(part.layer, self.layers[part.layer]) for part in self.description.outlines]
        return {key: outlines(layer.planes[0]) for key, layer in parts if isinstance(layer, Classes)}

    def values_at(self, theta_rad: float, z_mm: float) -> dict[str, float | None]:
        """Return the value of every layer of numbers at a place, None where nothing was observed there."""
        return {key: layer.plane.at(theta_rad, z_mm) for key, layer in self.layers.items() if isinstance(layer, Scalar)}
