"""Recordings rendered by threads and processes at the same time."""

import pytest

from endoct.base.compute.worker_process import worker_process
from endoct.base.errors import EndoctError
from endoct.synthetic.model import build_model, rendering
from tests.base.compute.worker_calls import end
from tests.synthetic.bones import bone, hole


def test_a_process_that_has_ended_is_reported_where_frames_are_taken() -> None:
    model = build_model(bone(hole()))
    with worker_process() as process:
        process.call(end)
        with pytest.raises(EndoctError, match="has ended"), rendering(model, [process]) as (_, frames):
            list(frames.results())
