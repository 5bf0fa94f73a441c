"""Filters side by side on one track: a target that waits, moves off and waits again."""

import numpy as np

from binopos_ros.smoothing import make_filter

RATE, DEVIATION = 30.0, np.array([1e-4, 1e-4, 1e-3])
times = np.arange(240) / RATE
truth = np.tile([0.0, 0.0, 1.2], (240, 1))
truth[:, 0] += 0.2 * np.clip(times - 3.0, 0.0, 2.0)
measured = truth + np.random.default_rng(5).normal(size=truth.shape) * DEVIATION

for name in ('none', 'kalman', 'huber', 'cloud-kalman'):
    smoother = make_filter(name)
    track = [
        smoother.step(time, position, np.diag(DEVIATION**2)).position
        for time, position in zip(times, measured, strict=True)
    ]
    error = 1000 * np.linalg.norm(np.array(track) - truth, axis=1)[30:]
    print(f'{name:13s} {np.sqrt(np.mean(error**2)):.3f} mm RMS, {error.max():.2f} mm at most')
