"""The one exception of the smoothing room."""

from __future__ import annotations


class SmoothingError(ValueError):
    """A filter's name or option is wrong; the message says which, and what is allowed.

    Bad *measurements* never raise: they come back as the reason of a :class:`FilterState`.
    """
