"""The terms of the edge's fit, by their rows, and what is likely of each before the fit."""

from __future__ import annotations

import numpy as np

# Those that depend on the distance alone come first.
BLUR, PROFILE, INSIDE, OUTSIDE = 0, slice(1, 3), 3, 4
MOTION, STRETCH, SHEAR = slice(5, 7), slice(7, 9), 9
SLOPES = slice(10, 14)
FLAT_TERMS = 14
DEPTH, TURNS, BENDS = 14, slice(15, 17), slice(17, 19)
SHADED_TERMS = 19
BLURS, TERMS = slice(19, 21), 21

# What is likely before the fit, as standard deviations (stretch as a share of the axes, blur in
# px, profile and slope as shares of the contrast). It steadies outlines of a few pixels.
LIKELY_STRETCH = 0.02
LIKELY_BLUR = 0.2
LIKELY_PROFILE = 0.05
LIKELY_SLOPE = 0.05
LIKELY_SHADE = 0.3

LIKELY, LIKELY_SLOPES = np.zeros(TERMS), np.zeros(TERMS)
LIKELY[STRETCH] = LIKELY[SHEAR] = LIKELY_STRETCH**-2
LIKELY[BLUR] = LIKELY[BLURS] = LIKELY_BLUR**-2
LIKELY[PROFILE] = LIKELY_PROFILE**-2
LIKELY[DEPTH] = LIKELY[TURNS] = LIKELY[BENDS] = LIKELY_SHADE**-2
LIKELY_SLOPES[SLOPES] = LIKELY_SLOPE**-2
