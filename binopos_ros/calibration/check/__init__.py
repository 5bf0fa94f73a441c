"""The third step: whether the calibration still holds, from ordinary operation."""
