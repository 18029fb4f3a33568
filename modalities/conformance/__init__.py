"""The conformance suite: what every modality's plug-in must do, checked on a recording of its own.

For a report of everything that is wrong::

    from endoct.modalities.conformance import check_modality
    from endoct.modalities.registry import manifests

    for complaint in check_modality(manifests()["profilometer"], Path("recording")):
        print(complaint)

For a test suite, one test a check::

    @pytest.fixture(scope="module")
    def subject() -> Subject:
        return Subject(MANIFEST, Path("recording"))

    @pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
    def test_conformance(check: Check, subject: Subject) -> None:
        check(subject)

The recording needs its ``acquisition.toml`` and should be small: it is surveyed several times.
"""

from collections.abc import Callable
from pathlib import Path

from endoct.base.errors import EndoctError
from endoct.modalities.conformance import recordings, unrolling
from endoct.modalities.conformance.subject import NotConforming, Subject, only_endoct_errors
from endoct.modalities.contract import Manifest

__all__ = ["CHECKS", "Check", "NotConforming", "Subject", "check_modality"]

Check = Callable[[Subject], None]

CHECKS: tuple[Check, ...] = (
    recordings.manifest_is_complete,
    recordings.manifest_is_light,
    recordings.sniff_claims_its_own,
    recordings.sniff_declines_with_a_reason,
    recordings.opening_reads_no_samples,
    recordings.stream_is_a_sequence,
    recordings.travel_turns_z_around,
    recordings.stream_is_picklable,
    recordings.frames_are_read_only,
    unrolling.calibration_is_complete,
    unrolling.survey_does_not_depend_on_workers,
    unrolling.unrolling_is_pure,
    unrolling.reading_once_changes_nothing,
    unrolling.strips_lie_on_the_grid,
    unrolling.strips_are_sound,
    unrolling.theta_is_a_circle,
    unrolling.settling_keeps_the_grid,
    unrolling.volumes_are_written,
    unrolling.illustrations_can_be_drawn,
    unrolling.places_are_located,
    unrolling.one_frame_is_a_recording,
    unrolling.bad_frames_raise_endoct_errors,
    recordings.bad_files_raise_endoct_errors,
)
"""Every check: a function of a :class:`Subject` that raises :class:`NotConforming`."""


def check_modality(manifest: Manifest, recording: Path) -> list[str]:
    """Run every check on ``manifest`` with ``recording``; return a line for each that failed, [] where all is well."""
    subject = Subject(manifest, recording)
    complaints = []
    for check in CHECKS:
        try:
            with only_endoct_errors(check.__name__):
                check(subject)
        except (NotConforming, EndoctError) as error:
            complaints.append(f"{check.__name__}: {error}")
    return complaints
