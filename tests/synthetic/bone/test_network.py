"""The mastoid in three dimensions: sizes and surface as measured, and what the drill must miss at its distance."""

import numpy as np
import pytest

from benchmarks.bone import NAMES, figures, lattice
from endoct.synthetic.bone.anatomy import (
    ANTRUM,
    CHORDA,
    COCHLEA,
    COVER_MM,
    FACIAL_NERVE,
    SINUS,
    sinus_and_antrum,
    structures,
)
from endoct.synthetic.bone.field import REACH_MM
from endoct.synthetic.bone.lattice import Lattice
from endoct.synthetic.bone.network import air_on, sites
from endoct.synthetic.bone.wall import build_wall
from endoct.synthetic.draw import draw

CROS_2016_PER_MM = 2.2
"""Surface to volume of eight aerated mastoids in micro-CT at 30–60 µm (Hearing Research 340, 127–134)."""


def test_surface_to_volume_is_that_of_micro_ct() -> None:
    samples = [draw("mastoid", seed) for seed in range(2000, 2008)]
    table = np.array([figures(air_on(sample, lattice())[0], lattice()) for sample in samples])
    of = dict(zip(NAMES, table.T, strict=True))
    assert np.mean(of["surface/volume mm⁻¹"]) == pytest.approx(CROS_2016_PER_MM, rel=0.15)
    # some bores are nearly dense, some are full of cells; and there are cells behind the wall that are not opened
    assert np.ptp(of["wall missing"]) > 0.15
    assert np.nanmean(of["closed behind wall"]) > 0.05


def test_pneumatisation_is_what_is_asked_for() -> None:
    def share(pneumatised: float) -> float:
        ranges = {"network.pneumatised": (pneumatised, pneumatised), "network.patchiness": (0.0, 0.0)}
        return float(sites(draw("learning", 1, ranges={"bore.bone": ("network",), **ranges})).air.mean())

    assert share(0.3) == pytest.approx(0.3, abs=0.06)
    assert share(0.8) == pytest.approx(0.8, abs=0.08)


def test_the_drill_passes_nerve_and_chorda_at_the_stated_distances() -> None:
    for seed in range(4):
        bore = draw("mastoid", seed).bore
        assert bore.network is not None
        turn, along = np.linspace(0, 2 * np.pi, 400), np.linspace(0, bore.length_mm, 400)
        radius = bore.diameter_mm / 2
        x, y, z = (
            one.astype(np.float32)
            for one in np.broadcast_arrays(radius * np.cos(turn)[:, None], radius * np.sin(turn)[:, None], along[None])
        )
        nearest = {one.label: float(one.distance_mm(x, y, z).min()) for one in structures(bore)}
        assert nearest[FACIAL_NERVE] == pytest.approx(bore.network.nerve_mm, abs=0.01)
        assert nearest[CHORDA] == pytest.approx(bore.network.chorda_mm, abs=0.01)
        assert nearest[COCHLEA] >= bore.network.cochlea_mm - 0.01


def test_no_cell_comes_near_a_nerve() -> None:
    sample = draw("mastoid", 2)
    clearance, _ = air_on(sample, lattice())
    x, y, z = lattice().places()
    nerves = structures(sample.bore)
    assert len(nerves) > 1
    for one in nerves:
        away = one.distance_mm(x, y, z)
        assert not np.any((away < COVER_MM / 2) & (clearance > 0))


def test_cells_keep_their_number_and_the_same_seed_is_the_same_bone() -> None:
    sample = draw("learning", 5, ranges={"bore.bone": ("network",)})
    wall = build_wall(sample)
    assert not np.any(wall.cell & (wall.cell_id == 0))
    numbers = np.unique(wall.cell_id[wall.cell])
    assert numbers.max() <= len(sites(sample).air)
    assert np.all(sites(sample).air[numbers - 1])
    again = build_wall(sample, workers=3)
    assert np.array_equal(wall.relief_mm, again.relief_mm)
    assert np.array_equal(wall.cell_id, again.cell_id)


def test_dust_and_fluid_lie_in_some_cells_and_are_said() -> None:
    ranges = {"bore.bone": ("network",), "bore.dust": (0.4, 0.4), "bore.fluid": (0.4, 0.4)}
    found = set()
    wet = 0.0
    for seed in range(3):
        wall = build_wall(draw("learning", seed, ranges=ranges))
        found |= {wall.scene.contents.filling[number] for number in np.unique(wall.cell_id)}
        wet += float(wall.wet.mean())
    assert found == {"air", "dust", "fluid"}
    assert wet > 0


def test_sinus_and_antrum_lie_at_their_distance_beyond_what_is_recorded() -> None:
    for seed in range(4):
        sample = draw("mastoid", seed)
        network, radius = sample.bore.network, sample.bore.diameter_mm / 2
        assert network is not None
        sinus, antrum = sinus_and_antrum(sample.bore)
        assert (sinus.label, antrum.label) == (SINUS, ANTRUM)
        z = np.linspace(-5, sample.bore.length_mm + 5, 400, dtype=np.float32)
        axis = np.zeros_like(z)
        assert sinus.distance_mm(axis, axis, z).min() == pytest.approx(radius + network.sinus_mm, abs=0.05)
        assert antrum.distance_mm(axis, axis, z).min() == pytest.approx(radius + network.antrum_mm, abs=0.05)
        recorded = Lattice.around_bore(sample.bore.length_mm, REACH_MM, 0.3)
        assert air_on(sample, recorded)[1].max() <= len(sites(sample).air)


def test_the_antrum_is_one_large_cell_and_the_sinus_holds_no_air() -> None:
    sample = draw("mastoid", 5)
    places = Lattice.around_bore(sample.bore.length_mm, 14.0, 0.25)
    clearance, cell = air_on(sample, places)
    x, y, z = places.places()
    sinus, antrum = sinus_and_antrum(sample.bore)
    assert not np.any(clearance[sinus.distance_mm(x, y, z) < COVER_MM / 2] > 0)
    inside = antrum.distance_mm(x, y, z) < -1.0
    assert np.mean(clearance[inside] > 0) > 0.95
    assert np.mean(cell[inside] == len(sites(sample).air) + 1) > 0.9
