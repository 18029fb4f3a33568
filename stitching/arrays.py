"""The same as :mod:`endoct.base.arrays`, for plug-ins that import it from here."""

from endoct.base.arrays import *  # noqa: F403
