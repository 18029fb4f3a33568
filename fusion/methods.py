"""Methods of segmentation and alignment by name: those that the research bench ranks, in a comparison.

A method is a function that a package registers under ``endoct.bench.segmentation`` or ``endoct.bench.alignment``; a
stranger's is chosen like one of ours.
"""

from typing import Literal

from endoct.base.entry_points import load_function
from endoct.base.errors import EndoctError, cause_of

OURS = "endoct"
"""The name of our own; what a comparison uses unless another is chosen."""


def answer_by(task: Literal["segmentation", "alignment"], name: str, *given: object) -> object:
    """Return what the method ``name`` of a ``task`` answers to what it is ``given``: one panorama, or A and B.

    Raises :class:`EndoctError` where there is no such method, or it raises anything.
    """
    method = load_function(f"endoct.bench.{task}", name, f"{task} method")
    try:
        return method(*given)
    except EndoctError:
        raise
    except Exception as error:  # a stranger's function may raise anything
        raise EndoctError(
            f"the {task} method '{name}' gives no answer",
            found=cause_of(error),
            remedy=f"choose another one, or leave {task}_method out",
        ) from error
