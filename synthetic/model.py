"""A specimen in memory: the drawn sample, and what is built from it for both instruments to look at."""

from dataclasses import dataclass

from endoct.synthetic.bone.baked_maps import TracedElsewhere
from endoct.synthetic.bone.wall import Wall, build_wall
from endoct.synthetic.endoscope.lighting import Lighting, lighting_of
from endoct.synthetic.oct.sweep import Appearance, build_appearance
from endoct.synthetic.sample.parameters import Sample


@dataclass(frozen=True, eq=False)
class Model:
    """The ``sample``, the ``wall`` it describes, how that looks to the OCT, and its ``lighting`` by the endoscope."""

    sample: Sample
    wall: Wall
    appearance: Appearance
    lighting: Lighting


def build_model(sample: Sample, elsewhere: TracedElsewhere = ()) -> Model:
    """Return the model of ``sample``; ``elsewhere`` is that of :func:`endoct.synthetic.bone.wall.build_wall`."""
    wall = build_wall(sample, elsewhere=elsewhere)
    return Model(sample, wall, build_appearance(sample, wall), lighting_of(sample, wall))
