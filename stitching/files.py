"""The same as :mod:`endoct.base.files.files`, for plug-ins that import it from here."""

from endoct.base.files.files import *  # noqa: F403
