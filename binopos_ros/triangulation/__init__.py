"""Pairs of pixels to points along bent rays, with their covariance; the refractive index, live."""

from binopos_ros.triangulation.errors import TriangulationError
from binopos_ros.triangulation.result import Triangulation
from binopos_ros.triangulation.triangulate import triangulate

__all__ = ['Triangulation', 'TriangulationError', 'triangulate']
