"""The paper's method, mended: where it must be exact, and what it must refuse."""

import pkgutil
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.triangulation.errors import TriangulationError
from binopos_ros.triangulation.meeting import PARALLEL
from binopos_ros.triangulation.paper import frame_index, triangulate_paper
from binopos_ros.triangulation.straight import BEHIND, NO_RAY

CAMERA = PinholeCamera(
    [[900.0, 0.0, 639.5], [0.0, 905.0, 479.5], [0.0, 0.0, 1.0]],
    [-0.12, 0.05, 0.001, -0.0005],
    (1280, 960),
)
WATER = FlatInterface((0, 0, 1), 0.8, (1.0, 1.33))


def rig_with(interface, rotation_vector=(0, 0, 0), translation=(-0.23, 0, 0), **ports):
    rotation = cv2.Rodrigues(np.array(rotation_vector, dtype=float))[0]
    return StereoRig(CAMERA, CAMERA, rotation, translation, interface, **ports)


def equally_far(rig, normal, depth, beside):
    """Points (N,3) as far from one camera's axis along the normal as from the other's."""
    centre = -rig.rotation.T @ rig.translation
    across = centre - (centre @ normal) * normal
    side = np.cross(normal, across / np.linalg.norm(across))
    return 0.5 * across + np.multiply.outer(beside, side) + np.multiply.outer(depth, normal)


def test_the_papers_worked_example_with_snell_the_right_way_up():
    """Sec. 5.2: E2 and m = -800 as printed; Eq. 12 mended puts the target at -1933.8 (ERRATA)."""
    virtual = np.array([1.023371, 1.277532, 2.676535])  # y down here, up in the paper
    air = rig_with(None)
    rig = rig_with(FlatInterface((0, 1, 0), 0.8, (1.0, 1.33)))
    points, reasons = triangulate_paper(rig, *air.project(virtual))
    assert reasons.tolist() == ['']
    assert points[0] == pytest.approx([1.023371, 1.9338, 2.676535], abs=5e-5)


@pytest.mark.parametrize('tilt', [(0, 0, 1), (0, 0.3, 1), (0, -0.5, 1)])
@pytest.mark.parametrize(('indices', 'thicknesses'), [((1, 1.33), ()), ((1, 1.5, 1.34), (0.02,))])
def test_is_exact_for_targets_equally_far_from_both_cameras(tilt, indices, thicknesses):
    interface = FlatInterface(tilt, 0.5, indices, thicknesses)
    rig = rig_with(interface)
    points = equally_far(rig, interface.normal, [0.7, 0.8, 1.2], [0.0, 0.1, -0.2])
    found, reasons = triangulate_paper(rig, *rig.project(points))
    assert reasons.tolist() == ['', '', '']
    assert found == pytest.approx(points, abs=1e-9)


def test_is_exact_everywhere_when_the_index_is_one():
    rig = rig_with(FlatInterface((0.1, 0.2, 1), 0.5, (1.0, 1.0)), (0.02, -0.05, 0.01))
    points = np.array([[0.3, -0.1, 1.1], [-0.2, 0.2, 0.9], [0.1, 0.0, 2.0]])
    found, _ = triangulate_paper(rig, *rig.project(points))
    assert found == pytest.approx(points, abs=1e-9)


def test_is_off_where_the_straight_rays_meet_the_common_line_at_different_heights():
    rig = rig_with(WATER)
    target = np.array([0.9, 0.0, 1.29])
    found, _ = triangulate_paper(rig, *rig.project(target))
    assert 1e-3 < np.linalg.norm(found[0] - target) < 0.1


def test_without_interface_it_is_the_virtual_point():
    rig = rig_with(None, (0.01, -0.1, 0.02))
    points = np.array([[0.1, 0.0, 1.0], [-0.2, 0.1, 3.0]])
    found, _ = triangulate_paper(rig, *rig.project(points))
    assert found == pytest.approx(points, abs=1e-9)


def test_a_target_on_the_left_cameras_own_normal_is_found():
    rig = rig_with(WATER)
    found, reasons = triangulate_paper(rig, *rig.project([0.0, 0.0, 1.2]))
    assert reasons[0] == ''
    assert found[0, 2] == pytest.approx(1.2, abs=0.01)


@pytest.mark.parametrize(
    ('left', 'right', 'reason'),
    [
        ((np.nan, 479.5), (500, 479.5), NO_RAY),
        ((639.5, 479.5), (639.5, 479.5), PARALLEL),
        ((500.0, 479.5), (600.0, 479.5), BEHIND),
        ((700.0, 479.5), (200.0, 479.5), 'target is not beyond the interface'),
    ],
)
def test_a_pair_without_a_point_has_a_reason_and_is_nan(left, right, reason):
    good = rig_with(WATER).project([0.1, 0.0, 1.2])
    points, reasons = triangulate_paper(rig_with(WATER), [left, good[0]], [right, good[1]])
    assert reasons.tolist() == [reason, '']
    assert np.isnan(points[0]).all()
    assert np.isfinite(points[1]).all()


def test_total_reflection_has_a_reason():
    """Out of glass (a port bonded to the lens) into air, 60 degrees off the normal."""
    glass = FlatInterface((0, 0.87, 0.5), 0.1, (1.5, 1.0))
    points, reasons = triangulate_paper(rig_with(glass), *rig_with(None).project([0.05, 0.0, 1.0]))
    assert reasons[0] == 'total reflection'
    assert np.isnan(points).all()


@pytest.mark.parametrize('method', [triangulate_paper, frame_index])
def test_ports_are_refused(method):
    rig = rig_with(None, left_port=WATER, right_port=WATER)
    with pytest.raises(TriangulationError, match='ports'):
        method(rig, (600, 400), (500, 400))


@pytest.mark.parametrize('method', [triangulate_paper, frame_index])
def test_pixels_of_unequal_number_are_refused(method):
    with pytest.raises(TriangulationError, match='shapes'):
        method(rig_with(WATER), [(600, 400), (1, 2)], [(500, 400)])


def test_frame_index_needs_an_interface():
    with pytest.raises(TriangulationError, match='no interface'):
        frame_index(rig_with(None), (600, 400), (500, 400))


@given(
    index=st.floats(1.05, 1.7),
    glass=st.booleans(),
    tilt=st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4)),
    x=st.floats(-0.5, 0.5),
    y=st.floats(-0.5, 0.5),
    below=st.floats(0.05, 1.0),
)
def test_frame_index_is_the_true_one_wherever_the_target_can_tell(index, glass, tilt, x, y, below):
    stack = ((1.0, 1.46, index), (0.012,)) if glass else ((1.0, index), ())
    interface = FlatInterface((*tilt, 1), 0.5, *stack)
    rig = rig_with(interface, (0.02, -0.1, 0.01), (-0.23, 0.02, 0.03))
    surface = 0.5 + sum(interface.thicknesses)
    along = np.array([x, y, 0.0])
    point = along + (surface + below - along @ interface.normal) * interface.normal
    normal = interface.normal
    centre = -rig.rotation.T @ rig.translation
    off_plane = point @ np.cross(normal, centre) / np.linalg.norm(np.cross(normal, centre))
    reaches = [np.linalg.norm(np.cross(point - eye, normal)) for eye in (np.zeros(3), centre)]
    assume(abs(off_plane) > 0.01)
    assume(abs(reaches[0] - reaches[1]) > 0.01)
    pixels = rig.project(point)
    assume(np.isfinite(pixels).all())
    found, reasons = frame_index(rig, *pixels)
    assert reasons[0] == ''
    assert found[0] == pytest.approx(index, abs=1e-6)


@pytest.mark.parametrize(
    ('left', 'right', 'reason'),
    [
        ((np.nan, 479.5), (500, 479.5), NO_RAY),
        ((500.0, 379.5), (600.0, 389.5), BEHIND),
        ((700.0, 579.5), (200.0, 679.5), 'target is not beyond the interface'),
        ((800.0, 700.0), (680.0, 650.0), 'no index makes the refracted rays meet'),
    ],
)
def test_a_pair_without_an_index_has_a_reason_and_is_nan(left, right, reason):
    good = rig_with(WATER).project([0.4, 0.2, 1.2])
    index, reasons = frame_index(rig_with(WATER), [left, good[0]], [right, good[1]])
    assert reasons.tolist() == [reason, '']
    assert np.isnan(index[0])
    assert index[1] == pytest.approx(1.33, abs=1e-6)


def test_frame_index_is_not_observable_equally_far_from_both_cameras():
    rig = rig_with(WATER)
    points = equally_far(rig, WATER.normal, [0.9, 1.0, 1.3], [0.1, 0.2, -0.3])
    index, reasons = frame_index(rig, *rig.project(points))
    assert np.isnan(index).all()
    assert all(reason.startswith('index not observable: target equally far') for reason in reasons)


def test_frame_index_is_not_observable_in_the_plane_of_both_centres_and_the_normal():
    rig = rig_with(FlatInterface((0.3, 0, 1), 0.6, (1, 1.33)))
    index, reasons = frame_index(rig, *rig.project([[0.4, 0.0, 1.2], [-0.1, 0.0, 1.0]]))
    assert np.isnan(index).all()
    assert all(
        reason.startswith('index not observable: target in the plane') for reason in reasons
    )


def test_every_function_that_the_map_of_equations_names_exists():
    page = (Path(__file__).parents[2] / 'docs' / 'paper.md').read_text()
    rows = [row.split(' | ') for row in page.splitlines() if re.match(r'\| \d', row)]
    numbers = {int(n) for row in rows if len(row) == 4 for n in re.findall(r'\d+', row[0])}
    assert numbers == set(range(1, 27))
    named = {name for row in rows if len(row) == 4 for name in re.findall(r'`([\w.]+)`', row[2])}
    named |= set(re.findall(r'`((?:detection|smoothing)\.[\w.]+)`', page))
    for name in named:
        pkgutil.resolve_name(f'binopos_ros.{name}')
