"""One pair made, compared and judged: a row of the table."""

import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.independent.judge import (
    Wall,
    against_truth,
    depth_errors,
    loss_of_alignment,
    measured_place,
    misplaced,
    pair_jaccard,
    wrong_share,
)
from benchmarks.independent.ours import Answer, endoct_answer, endoct_oct
from benchmarks.independent.pair import Pair, make_pair, make_pullback, write_pair, write_pullback
from benchmarks.independent.sets import recipe_of
from benchmarks.independent.simplest import simplest_answer, simplest_oct
from benchmarks.independent.truth import between, oct_place
from endoct.base.errors import EndoctError

Row = dict[str, str | float | bool]


CHAINS = ("endoct", "simplest")


def judged(name: str, seed: int, chains: Sequence[str] = CHAINS) -> list[Row]:
    """Return a row for each chain's answer to one pair of a set."""
    began = time.perf_counter()
    pair = make_pair(recipe_of(name, seed), seed)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "pair"
        write_pair(pair, folder)
        made = time.perf_counter() - began
        answers = {"endoct": lambda: endoct_answer(folder), "simplest": lambda: simplest_answer(pair)}
        rows = [_row(name, seed, chain, pair, answers[chain]) for chain in chains]
    return [row | {"seconds_made": made} for row in rows]


def _row(name: str, seed: int, chain: str, pair: Pair, answer_to: Callable[[], Answer]) -> Row:
    e = pair.recipe.endoscope
    row: Row = {"set": name, "seed": seed, "chain": chain, "fault": pair.recipe.oct.fault or e.fault or ""}
    row |= {"fault_size": pair.recipe.oct.fault_size, "stated": e.stated, "cells": len(pair.bore.cells)}
    row |= {"half_angle_deg": e.half_angle_deg, "distance_mm": e.distance_mm, "ahead": e.ahead}
    began = time.perf_counter()
    try:
        answer = answer_to()
    except EndoctError as error:
        return row | {"outcome": "refused", "reason": str(error), "seconds": time.perf_counter() - began}
    except Exception as error:  # noqa: BLE001  a chain that breaks is a finding, and the others are still to be judged
        return row | {"outcome": "crashed", "reason": repr(error), "seconds": time.perf_counter() - began}
    row |= {"seconds": time.perf_counter() - began, "reason": answer.reason, "doubts": "; ".join(answer.doubts)}
    return row | scores(pair, answer)


def judged_oct(name: str, seed: int) -> list[Row]:
    """Return a row for each chain's answer to one pullback of a set."""
    recipe = recipe_of(name, seed)
    bore, pullback = make_pullback(recipe, seed)
    place = oct_place(recipe.oct, pullback)
    row: Row = {"set": name, "seed": seed, "stated": "", "fault": recipe.oct.fault or "", "cells": len(bore.cells)}
    row["fault_size"] = recipe.oct.fault_size
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        write_pullback(pullback, recipe, Path(scratch))
        answers: dict[str, Callable[[], tuple[Wall, tuple[str, ...]]]] = {
            "endoct": lambda: endoct_oct(Path(scratch)),
            "simplest": lambda: (simplest_oct(pullback, recipe)[0], ()),
        }
        for chain, answer_to in answers.items():
            try:
                wall, doubts = answer_to()
            except EndoctError as error:
                rows.append(row | {"chain": chain, "outcome": "refused", "reason": str(error)})
                continue
            row_of = row | {"chain": chain, "outcome": "unrolled", "doubts": "; ".join(doubts)}
            row_of |= {"jaccard_oct": against_truth(bore, place, wall), "wrong_oct": wrong_share(bore, place, wall)}
            rows.append(row_of)
    return rows


def scores(pair: Pair, answer: Answer) -> Row:
    """Return what the judge says of an answer."""
    a, b, bore = answer.endoscope, answer.oct, pair.bore
    b_place = pair.oct_place
    a_place, fit = measured_place(bore, a, pair.endoscope_place)
    true, stated = between(a_place, b_place), answer.oct_in_endoscope
    row: Row = {
        "outcome": "aligned" if stated else "not aligned",
        "jaccard_endoscope": against_truth(bore, a_place, a),
        "jaccard_oct": against_truth(bore, b_place, b),
        "wrong_oct": wrong_share(bore, b_place, b),
        "jaccard_true_place": pair_jaccard(a, b, true),
        "endoscope_place_fit": fit,
        "endoscope_place_z_mm": a_place.z_mm - pair.endoscope_place.z_mm,
        "endoscope_place_theta_rad": a_place.theta_rad - pair.endoscope_place.theta_rad,
        "endoscope_place_scale": a_place.scale,
    }
    row["wall_depth_mm"], row["cell_depth_ratio"] = depth_errors(bore, b_place, b)
    if stated is None:
        return row
    error = misplaced(stated, true, b, answer.covariance)
    row |= {f"error_{key}": value for key, value in vars(error).items()}
    row["jaccard_pair"] = pair_jaccard(a, b, stated)
    row["loss_true"] = loss_of_alignment(bore, a, b, a_place, b_place, stated)
    if answer.alignment_share is not None:
        row["loss_stated"] = answer.alignment_share
    return row
