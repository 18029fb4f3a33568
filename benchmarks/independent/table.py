"""What a run comes to, in words and figures."""

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from benchmarks.independent.judge import coverage

_SCORES = (
    "jaccard_endoscope",
    "jaccard_oct",
    "wrong_oct",
    "jaccard_pair",
    "jaccard_true_place",
    "loss_true",
    "loss_stated",
    "seconds",
)
_ERRORS = {"error_theta_rad": "error_theta_sigmas", "error_z_mm": "error_z_sigmas", "error_scale": "error_scale_sigmas"}


def line(row: Mapping[str, object]) -> str:
    """Return one pair in one line."""

    def number(key: str, digits: int = 3) -> str:
        value = row.get(key)
        return f"{value:.{digits}f}" if isinstance(value, float) and np.isfinite(value) else "–"

    said = f"{row['set']} {row['seed']:>3} {row['chain']:8s} {row['outcome']:11s}"
    said += f" endoscope {number('jaccard_endoscope')} oct {number('jaccard_oct')} pair {number('jaccard_pair')}"
    said += f" θ {number('error_theta_rad', 4)} ({number('error_theta_sigmas', 1)}σ)"
    said += f" z {number('error_z_mm', 4)} ({number('error_z_sigmas', 1)}σ)"
    said += f" scale {number('error_scale', 4)} ({number('error_scale_sigmas', 1)}σ)"
    said += f" loss {number('loss_stated')}/{number('loss_true')}"
    fault = f" {row['fault']} {row['fault_size']}" if row["fault"] else ""
    return f"{said} {row['stated']}{fault} {row.get('doubts') or ''} {row.get('reason') or ''}".rstrip()


def summary(table: pd.DataFrame) -> str:
    """Return medians, worst cases and coverage of each chain."""
    return "\n".join(text for chain, rows in table.groupby("chain") for text in _of_chain(str(chain), rows))


def _of_chain(chain: str, rows: pd.DataFrame) -> Iterator[str]:
    outcomes = ", ".join(f"{count} {name}" for name, count in rows["outcome"].value_counts().items())
    yield f"\n{chain}: {len(rows)} pairs, {outcomes}; {(_doubts(rows) != '').sum()} doubted"
    for name in _SCORES:
        if name in rows and (values := rows[name].dropna()).size:
            said = f"median {values.median():.3f}, from {values.min():.3f} to {values.max():.3f}"
            yield f"  {name:22s} {said} ({values.size})"
    for name, in_sigmas in _ERRORS.items():
        if name in rows and (values := rows[name].abs().dropna()).size:
            said = f"  |{name}|".ljust(24) + f" median {values.median():.4f}, worst {values.max():.4f}"
            for share, rms, count in coverage({name: rows[in_sigmas].to_numpy(float)}).values():
                said += f"; within 2σ {share:.0%} of {count}, rms {rms:.2f}σ"
            yield said
    if "loss_stated" in rows and (ratio := (rows["loss_stated"] / rows["loss_true"]).dropna()).size:
        within = ((ratio > 1 / 1.5) & (ratio < 1.5)).mean()
        yield f"  loss stated / true      median {ratio.median():.2f}; {within:.0%} within a factor of 1.5"
    yield from _of_doubts(rows)
    yield from _of_faults(rows)


def _of_doubts(rows: pd.DataFrame) -> Iterator[str]:
    each = _doubts(rows).str.split("; ").explode()
    for doubt, count in each[each != ""].value_counts().items():
        yield f"  doubted {count:3d} times: {doubt}"


def _of_faults(rows: pd.DataFrame) -> Iterator[str]:
    """Yield for each fault what became of it; believed in silence is what was aligned without a doubt."""
    for (fault, size), group in rows[rows["fault"] != ""].groupby(["fault", "fault_size"]):
        silent = (group["outcome"] == "aligned") & (_doubts(group) == "")
        said = ", ".join(f"{count} {name}" for name, count in group["outcome"].value_counts().items())
        errors = {name: group[name].abs().max() for name in _ERRORS if name in group}
        worst = ", ".join(f"{name.removeprefix('error_')} {value:.3f}" for name, value in errors.items())
        scores = ", ".join(
            f"{name.removeprefix('jaccard_')} {group[name].median():.3f}"
            for name in ("jaccard_endoscope", "jaccard_oct", "jaccard_pair")
            if name in group
        )
        yield (
            f"  {fault} {size:g}: {said}; {silent.sum()} of {len(group)} believed in silence; at most {worst} off; "
            f"median {scores}"
        )


def _doubts(rows: pd.DataFrame) -> "pd.Series[str]":
    return rows["doubts"].fillna("") if "doubts" in rows else pd.Series("", index=rows.index)
