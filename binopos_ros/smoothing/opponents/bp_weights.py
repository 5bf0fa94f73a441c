"""Weights of the BP-Kalman's network, found by ``python bench/tune_filters.py bp-kalman``."""

HIDDEN = [[0.0] * 8] * 7
HIDDEN_BIAS = [0.0] * 8
OUTPUT = [0.0] * 8
OUTPUT_BIAS = 0.0
