"""A plane that the target lies in: what it says about the index, and where it holds the point."""

import math

import numpy as np
import pytest
from scipy import optimize

from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.triangulation.depth_aid import KnownPlane
from binopos_ros.triangulation.errors import TriangulationError
from binopos_ros.triangulation.evidence import gather_evidence

PIXEL_STD = 0.1
COVARIANCE = PIXEL_STD**2 * np.array([[1.0, 0.3], [0.3, 2.0]])
WHITEN = np.kron(np.eye(2), np.linalg.inv(np.linalg.cholesky(COVARIANCE)))
CAMERA = PinholeCamera([[900, 0, 639.5], [0, 900, 479.5], [0, 0, 1]], [], (1280, 960))
INTERFACE = FlatInterface((0.1, 0.2, 1), 0.4, (1.0, 1.5, 1.34), (0.01,))
RIG = StereoRig(CAMERA, CAMERA, np.eye(3), (-0.23, 0.0, 0.0), INTERFACE)
FLOOR = KnownPlane((0.1, 0.1, 1), 1.0, 1e-3)
PLACES = [(0.0, 0.1), (0.115, 0.0), (0.4, 0.3)]


def on_floor(x, y):
    return np.array([x, y, (FLOOR.offset - FLOOR.normal[:2] @ (x, y)) / FLOOR.normal[2]])


def images(rig, point):
    return np.concatenate(rig.project(point))


def evidence_of(pixels):
    return gather_evidence(RIG, pixels[:2], pixels[2:], COVARIANCE, COVARIANCE)


@pytest.mark.parametrize('place', PLACES)
def test_the_rays_clue_and_the_planes_clue_make_up_the_whole_information(place):
    """Against the Fisher matrix of point and index by finite differences, the plane exact."""
    point, h = on_floor(*place), 1e-5
    by_point = [(images(RIG, point + h * e) - images(RIG, point - h * e)) for e in np.eye(3)]
    by_index = [images(RIG.with_target_index(1.34 + s), point) for s in (h, -h)]
    columns = np.column_stack([*by_point, by_index[0] - by_index[1]]) / (2 * h)
    rows = np.vstack([WHITEN @ columns, [*(FLOOR.normal * 1e8), 0.0]])
    whole = 1.0 / np.linalg.inv(rows.T @ rows)[3, 3]
    evidence = evidence_of(images(RIG, point))
    told = evidence.clue.gain**2 + FLOOR.clue(evidence).gain ** 2
    assert told == pytest.approx(whole, rel=1e-4)


@pytest.mark.parametrize('place', PLACES)
def test_the_point_held_in_the_plane_is_the_likeliest_one_there(place):
    noise = PIXEL_STD * np.array([0.3, -0.5, 0.8, 0.2])
    pixels = images(RIG, on_floor(*place)) + noise
    evidence = FLOOR.hold(evidence_of(pixels))
    best = optimize.least_squares(
        lambda xy: WHITEN @ (images(RIG, on_floor(*xy)) - pixels), place, xtol=1e-14, ftol=1e-14
    )
    assert evidence.point == pytest.approx(on_floor(*best.x), abs=1e-6)
    assert FLOOR.normal @ evidence.point == pytest.approx(FLOOR.offset, abs=1e-12)
    # The covariance at an exact plane: the fit's own, and none across the plane.
    assert FLOOR.normal @ evidence.covariance @ FLOOR.normal == pytest.approx(0.0, abs=1e-16)
    expected = np.linalg.inv(best.jac.T @ best.jac)
    assert evidence.covariance[:2, :2] == pytest.approx(expected, rel=1e-3)


def test_a_point_in_the_plane_at_the_right_index_gives_no_innovation():
    clue = FLOOR.clue(evidence_of(images(RIG, on_floor(0.2, 0.1))))
    assert clue.innovation == pytest.approx(0.0, abs=1e-6)
    deeper = RIG.with_target_index(1.36)
    clue = FLOOR.clue(evidence_of(images(deeper, on_floor(0.2, 0.1))))
    assert clue.innovation / clue.gain == pytest.approx(0.02, rel=0.05)


def test_a_depth_is_measured_beyond_the_last_surface():
    plane = KnownPlane.at_depth(INTERFACE, 0.3, 1e-3)
    assert plane.offset == pytest.approx(0.4 + 0.01 + 0.3)
    assert plane.normal == pytest.approx(INTERFACE.normal)


@pytest.mark.parametrize(
    ('normal', 'offset', 'std', 'message'),
    [
        ((0, 0, 0), 1.0, 1e-3, 'direction'),
        ((0, 1), 1.0, 1e-3, 'direction'),
        ((0, 0, math.nan), 1.0, 1e-3, 'direction'),
        ((0, 0, 1), math.inf, 1e-3, 'offset'),
        ((0, 0, 1), 1.0, 0.0, 'standard deviation'),
        ((0, 0, 1), 1.0, math.nan, 'standard deviation'),
    ],
)
def test_an_impossible_plane_is_refused_in_one_line(normal, offset, std, message):
    with pytest.raises(TriangulationError, match=message) as caught:
        KnownPlane(normal, offset, std)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('depth', [0.0, -0.1, math.nan])
def test_a_depth_before_the_surface_is_refused(depth):
    with pytest.raises(TriangulationError, match='beyond the interface'):
        KnownPlane.at_depth(INTERFACE, depth, 1e-3)
