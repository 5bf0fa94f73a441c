"""Tuned defaults of every filter, found by ``python bench/smoothing/tune.py``."""

from __future__ import annotations

TUNED: dict[str, dict[str, float]] = {
    'bp-kalman': {
        'acceleration_density': 0.0001892,
        'measurement_scale': 21.5,
        'measurement_std': 0.002774,
    },
    'cloud-kalman-paper': {
        'acceleration_density': 0.00112,
        'measurement_scale': 22.05,
        'measurement_std': 0.006037,
        'window': 7,
    },
    'coloured-noise': {
        'acceleration_density': 1.851e-05,
        'damping': 0.2601,
        'frequency': 6.0,
        'measurement_scale': 5.29,
        'measurement_std': 0.0006338,
    },
    'huber': {
        'acceleration_density': 0.0003175,
        'measurement_scale': 11.15,
        'measurement_std': 0.0003036,
        'threshold': 2.466,
    },
    'imm': {
        'dwell': 8.022,
        'high_density': 0.0009739,
        'low_density': 8.089e-09,
        'measurement_scale': 87.21,
        'measurement_std': 0.01716,
        'middle_density': 0.01588,
    },
    'kalman': {
        'acceleration_density': 0.0001892,
        'measurement_scale': 21.5,
        'measurement_std': 0.002774,
    },
    'kalman-random-walk': {
        'measurement_scale': 46.18,
        'measurement_std': 0.003457,
        'walk_density': 5.402e-05,
    },
    'median': {'window': 6},
    'sage-husa': {
        'acceleration_density': 1.108e-05,
        'divergence': 1.2,
        'forgetting': 0.9968,
        'measurement_scale': 3.941,
        'measurement_std': 0.002489,
    },
    'student-t': {
        'acceleration_density': 0.003633,
        'freedom': 12.54,
        'measurement_scale': 246.3,
        'measurement_std': 0.00971,
    },
    'variational-bayes': {
        'acceleration_density': 0.01036,
        'measurement_scale': 30.97,
        'measurement_std': 0.0008655,
        'spreading': 0.8167,
    },
}
