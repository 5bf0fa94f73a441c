"""Cameras: V4L2 streaming, USB identity, pairing of left and right, recovery."""
