"""One point on floats, through planes at angles too: the same ray as a batch's convex search."""

from __future__ import annotations

import numpy as np

from binopos_ros.optics import StereoRig
from binopos_ros.optics.aiming import aim
from binopos_ros.optics.arithmetic import FLOATS, NoRayError
from binopos_ros.optics.crossing import crossings


def sights(rig: StereoRig, point: np.ndarray) -> list | None:
    x, y, z = point.tolist()
    try:
        return [view.sight((x, y, z), FLOATS) for view in rig.views]
    except NoRayError:
        return None


def test_one_point_is_seen_as_in_a_batch(rig: StereoRig) -> None:
    """Pixels to 1e-9 px, derivatives to 1e-7; no ray where the batch has none."""
    points = np.random.default_rng(3).uniform([-0.8, -0.8, 0.3], [0.8, 0.8, 3.0], (300, 3))
    batch = rig.differentiate(points)
    seen = 0
    for i, point in enumerate(points):
        single = sights(rig, point)
        exists = np.isfinite(batch.left[i]).all() and np.isfinite(batch.right[i]).all()
        assert (single is not None) == exists
        # Far outside any image the last digit of a direction is more than a billionth of a pixel.
        if single is None or np.abs([batch.left[i], batch.right[i]]).max() > 5000:
            continue
        seen += 1
        found = (
            (single[0], batch.left[i], batch.left_by_point[i], batch.left_by_index[i]),
            (single[1], batch.right[i], batch.right_by_point[i], batch.right_by_index[i]),
        )
        for sight, pixel, by_point, by_index in found:
            np.testing.assert_allclose([sight.u, sight.v], pixel, rtol=0, atol=1e-9)
            for one, many in (
                ([sight.u_by_point, sight.v_by_point], by_point),
                ([sight.u_by_index, sight.v_by_index], by_index),
            ):
                np.testing.assert_allclose(one, many, rtol=0, atol=1e-7 * np.abs(many).max())
    assert seen > 100


def test_newton_and_fermat_agree_on_the_ray(crossed: StereoRig) -> None:
    """The optical path's minimum knows neither Snell's law nor a derivative of it."""
    surfaces = crossed.left_view.surfaces
    points = np.random.default_rng(4).uniform([-2, -2, 0.9], [2, 2, 3.0], (500, 3))
    least = crossings(
        surfaces.normals, surfaces.offsets, surfaces.bases, np.array(surfaces.indices), points
    )
    found = 0
    for point, crossing in zip(points, least[:, 0], strict=True):
        ray = aim(surfaces, tuple(point.tolist()))
        if ray is None or not np.isfinite(crossing).all():
            continue
        found += 1
        expected = crossing[:2] / crossing[2]
        np.testing.assert_allclose((ray.a, ray.b), expected, rtol=1e-11, atol=1e-11)
    assert found > 400


def test_a_rig_with_another_target_index_is_that_rig(bent_rig: StereoRig) -> None:
    """What it keeps of the old rig must not show."""
    rig = bent_rig
    other = rig.with_target_index(1.36)
    built = StereoRig(
        rig.left,
        rig.right,
        rig.rotation,
        rig.translation,
        other.interface,
        other.left_port,
        other.right_port,
    )
    points = np.random.default_rng(5).uniform([-0.3, -0.3, 1.0], [0.3, 0.3, 1.6], (50, 3))
    for kept, fresh in zip(other.project(points), built.project(points), strict=True):
        np.testing.assert_array_equal(kept, fresh)
    pairs = zip(other.parameter_jacobian(points), built.parameter_jacobian(points), strict=True)
    for kept, fresh in pairs:
        np.testing.assert_array_equal(kept, fresh)
    assert other.target_index == built.target_index == 1.36
    assert rig.target_index != 1.36
