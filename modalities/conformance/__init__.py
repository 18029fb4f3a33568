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
from endoct.modalities.conformance import recording_checks, unrolling_checks
from endoct.modalities.conformance.subject import NotConforming, Subject, only_endoct_errors
from endoct.modalities.contract import Manifest

__all__ = ["CHECKS", "Check", "NotConforming", "Subject", "check_modality"]

Check = Callable[[Subject], None]

CHECKS: tuple[Check, ...] = (
    recording_checks.manifest_is_complete,
    recording_checks.manifest_is_light,
    recording_checks.sniff_claims_its_own,
    recording_checks.sniff_declines_with_a_reason,
    recording_checks.opening_reads_no_samples,
    recording_checks.stream_is_a_sequence,
    recording_checks.travel_turns_z_around,
    recording_checks.stream_is_picklable,
    recording_checks.frames_are_read_only,
    unrolling_checks.calibration_is_complete,
    unrolling_checks.survey_does_not_depend_on_workers,
    unrolling_checks.unrolling_is_pure,
    unrolling_checks.reading_once_changes_nothing,
    unrolling_checks.strips_lie_on_the_grid,
    unrolling_checks.strips_are_sound,
    unrolling_checks.theta_is_a_circle,
    unrolling_checks.settling_keeps_the_grid,
    unrolling_checks.volumes_are_written,
    unrolling_checks.illustrations_can_be_drawn,
    unrolling_checks.places_are_located,
    unrolling_checks.one_frame_is_a_recording,
    unrolling_checks.bad_frames_raise_endoct_errors,
    recording_checks.bad_files_raise_endoct_errors,
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
