"""Tuned defaults of every filter, found by ``python bench/tune_filters.py``."""

from __future__ import annotations

TUNED: dict[str, dict[str, float]] = {
    'kalman': {
        'measurement_scale': 1.0,
        'measurement_std': 0.005,
        'acceleration_density': 0.05,
    },
}
