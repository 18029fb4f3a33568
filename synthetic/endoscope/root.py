"""Where a function is 0, by the method of Brent (1973): the code of SciPy's brentq, step by step, to the last bit.

SciPy's own comes with all of scipy.optimize, which takes a third of a second to load, for one number a specimen.
"""

from collections.abc import Callable

MOST_STEPS = 100


def root(function: Callable[[float], float], low: float, high: float, *, within: float, share: float) -> float:
    """Return x between ``low`` and ``high``, where ``function`` has different signs, to ``within`` + ``share``·|x|.

    Raises ValueError where the signs are the same, or no such x is found.
    """
    before, now = low, high
    f_before, f_now = function(before), function(now)
    if f_before == 0:
        return before
    if f_now == 0:
        return now
    if (f_before < 0) == (f_now < 0):
        raise ValueError(f"no change of sign between {low} and {high}")
    other = f_other = step = last_step = 0.0
    for _ in range(MOST_STEPS):
        if f_before != 0 and f_now != 0 and (f_before < 0) != (f_now < 0):
            other, f_other = before, f_before
            step = last_step = now - before
        if abs(f_other) < abs(f_now):
            before, now, other = now, other, now
            f_before, f_now, f_other = f_now, f_other, f_now
        least = (within + share * abs(now)) / 2
        half = (other - now) / 2
        if f_now == 0 or abs(half) < least:
            return now
        if abs(last_step) > least and abs(f_now) < abs(f_before):
            if before == other:
                wished = -f_now * (now - before) / (f_now - f_before)
            else:
                slope = (f_before - f_now) / (before - now)
                slope_other = (f_other - f_now) / (other - now)
                wished = (
                    -f_now * (f_other * slope_other - f_before * slope) / (slope_other * slope * (f_other - f_before))
                )
            near = 2 * abs(wished) < min(abs(last_step), 3 * abs(half) - least)
            last_step, step = (step, wished) if near else (half, half)
        else:
            last_step = step = half
        before, f_before = now, f_now
        now += step if abs(step) > least else (least if half > 0 else -least)
        f_now = function(now)
    raise ValueError(f"no root found between {low} and {high}")
