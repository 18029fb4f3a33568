"""What is known of the profilometer without loading it."""

from pydantic import Field

from endoct.modalities.acquisition import Acquisition, Handedness
from endoct.modalities.contract import Manifest


class ProfilometerAcquisition(Acquisition):
    """The sidecar of a profilometer recording."""

    pitch_mm: float = Field(gt=0, description="distance between two turns along the bore; sets mm along z")
    handedness: Handedness = Field(default="unknown", description="sense in which θ grows over a file's lines")


MANIFEST = Manifest(
    name="profilometer",
    title="laser line profilometer",
    suffixes=(".csv",),
    acquisition=ProfilometerAcquisition,
    provides=frozenset({"intensity", "depth"}),
    frame_dim="turn",
    implementation="endoct_profilometer.modality:PROFILOMETER",
)
