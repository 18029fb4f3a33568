"""The same as :mod:`endoct.base.errors`, for plug-ins that import it from here."""

from endoct.base.errors import *  # noqa: F403
