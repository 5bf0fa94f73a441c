"""Tuned defaults of every filter, found by ``python bench/tune_filters.py``."""

from __future__ import annotations

TUNED: dict[str, dict[str, float]] = {'kalman': {'acceleration_density': 0.0002166,
            'measurement_scale': 11.04,
            'measurement_std': 0.003462}}
