"""Results as plain JSON values: no arrays, no numbers that are not finite."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

Json = None | bool | int | float | str | list["Json"] | dict[str, "Json"]


def finite(value: object) -> Json:
    """Make plain JSON of results: arrays to lists, numbers that are not finite to null.

    Parameters
    ----------
    value
        Numbers, texts, arrays, and tuples, lists and mappings of them.

    Returns
    -------
    What :func:`json.dumps` takes with ``allow_nan=False``.
    """
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return finite(value.tolist())
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    raise TypeError(f"{type(value).__name__} is no part of a result")
