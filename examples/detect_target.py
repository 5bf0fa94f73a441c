"""Render a picture of the washbowl, and find the target in it to hundredths of a pixel."""

import numpy as np

from binopos_ros.detection import detect
from binopos_ros.simulation import PRESETS, Choices, Renderer

scene = PRESETS['demo'].make(Choices(seed=3))
picture = Renderer(scene, 0).picture(0.0, np.random.default_rng(3))
target = detect(picture)
print(f'centre {target.centre.round(2)} px, diameter {target.diameter:.1f} px')
print(f'standard deviations {np.sqrt(np.diag(target.covariance)).round(3)} px')
