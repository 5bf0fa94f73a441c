"""Interfaces: simulated rigs against their truth, what is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

from binopos_ros.calibration.adjustment.adjust import view_information
from binopos_ros.calibration.adjustment.positions import calibration_covariances
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.interface.calibrate import calibrate_interface
from binopos_ros.calibration.interface.guesses import InterfaceGuess
from binopos_ros.calibration.report.verdicts import (
    DETERMINED,
    IRRELEVANT,
    PRIOR,
    WEAK,
    advice,
    verdicts,
)
from binopos_ros.calibration.views.balls import ball_view
from binopos_ros.calibration.views.pose import Pose
from binopos_ros.calibration.views.targets import Blob
from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.optics.covariance_file import ParameterCovariance
from binopos_ros.optics.rig_state import RigState, exponential
from binopos_ros.triangulation import triangulate

KINDS = ('surface', 'wall', 'ports')
RIGS = 51
TILTS = (15.0, 55.0)
EVERYWHERE = (0.6, 0.5)  # parts of the depth: as far aside as both pictures reach

of_all_rigs = pytest.mark.xdist_group('calibration of all rigs')


class Outcomes:
    """Errors and stated deviations over all rigs, by kind of parameter."""

    def __init__(self) -> None:
        self.errors: dict[str, list[float]] = {}
        self.deviations: dict[str, list[float]] = {}
        self.joint: list[bool] = []
        self.ratios: list[float] = []
        self.factors: list[float] = []

    def add(self, name: str, error: float, deviation: float) -> None:
        self.errors.setdefault(name, []).append(error)
        self.deviations.setdefault(name, []).append(deviation)

    def rms(self, name: str) -> float:
        return float(np.sqrt(np.mean(np.square(self.errors[name]))))


@pytest.fixture(scope='module')
def outcomes(rig_maker: Any, board_viewer: Any, guesser: Any) -> Outcomes:
    """51 rigs, 17 of each kind, calibrated from ten views mixed in tilt and place, 0.1 px."""
    found = Outcomes()
    for i in range(RIGS):
        rng = np.random.default_rng(5000 + i)
        rig, depths = rig_maker(KINDS[i % 3], rng)
        views = board_viewer(rig, depths, rng, tilts=TILTS, aside=EVERYWHERE)
        truth = RigState.of(rig)
        result = calibrate_interface(replace(truth, interfaces={}), views, guesser(rig))
        error = -truth.minus(result.state)
        names = result.state.names
        own = [
            names.index(name)
            for name in result.interface_names
            if 'thicknesses' not in name and 'indices' not in name
        ]
        for column in own:
            kind = next(k for k in ('index', 'normal', 'distance') if k in names[column])
            found.add(kind, error[column], result.deviation(names[column]))
        square = error[own] @ np.linalg.solve(result.covariance[np.ix_(own, own)], error[own])
        found.joint.append(bool(square < chi2.ppf(0.95, len(own))))
        assert result.adjustment is not None
        found.factors.append(result.adjustment.variance_factor)
        found.ratios.append(position_ratio(rig, depths, result.state, result.covariance, rng))
    return found


def position_ratio(
    rig: Any, depths: tuple[float, float], state: RigState, covariance: np.ndarray, rng: Any
) -> float:
    """Squared error of an independent target over the bound from pixels and calibration."""
    depth = rng.uniform(*depths, 200)
    centre = -rig.rotation.T @ rig.translation / 2.0
    aside = rng.uniform(-0.15, 0.15, (200, 2)) * depth[:, None]
    points = np.column_stack([centre[:2] + aside, depth])
    seen = [p + rng.normal(scale=0.1, size=p.shape) for p in rig.project(points)]
    pixel = 0.01 * np.eye(2)
    found = triangulate(state.rig(), *seen, pixel, pixel)
    good = found.reasons == ''
    known = ParameterCovariance(state.names, covariance)
    bound = found.covariances[good] + calibration_covariances(state, found.points[good], known)
    error = np.sum((found.points[good] - points[good]) ** 2, axis=1)
    return float(error.mean() / np.trace(bound, axis1=1, axis2=2).mean())


@of_all_rigs
@pytest.mark.parametrize(
    ('name', 'wanted'), [('index', 0.0025), ('normal', np.radians(0.1)), ('distance', 0.004)]
)
def test_errors_over_all_rigs(outcomes: Outcomes, name: str, wanted: float) -> None:
    assert outcomes.rms(name) < wanted


@of_all_rigs
@pytest.mark.parametrize('name', ['index', 'normal', 'distance'])
def test_stated_deviations_are_those_of_the_errors(outcomes: Outcomes, name: str) -> None:
    ratio = np.array(outcomes.errors[name]) / outcomes.deviations[name]
    assert np.std(ratio) == pytest.approx(1.0, abs=0.2)
    assert 0.90 < np.mean(np.abs(ratio) < 1.96) < 0.99


@of_all_rigs
def test_truth_lies_in_the_stated_region_in_95_of_100_runs(outcomes: Outcomes) -> None:
    assert 0.93 <= np.mean(outcomes.joint) <= 0.97


@of_all_rigs
def test_independent_points_are_taken_for_such(outcomes: Outcomes) -> None:
    assert np.mean(np.array(outcomes.factors) > 1.0) < 0.05


@of_all_rigs
def test_independent_positions_reach_the_bound(outcomes: Outcomes) -> None:
    assert np.sqrt(np.mean(outcomes.ratios)) < 1.1


def test_flat_boards_leave_the_index_open_and_say_so(
    rig_maker: Any, board_viewer: Any, guesser: Any
) -> None:
    rng = np.random.default_rng(4)
    rig, depths = rig_maker('surface', rng)
    views = board_viewer(rig, depths, rng, count=4, tilts=(0.0, 1.0))
    air = replace(RigState.of(rig), interfaces={})
    result = calibrate_interface(air, views, guesser(rig))
    index = verdicts(result)[0]
    assert index.name == 'target_index'
    assert index.grade in (WEAK, PRIOR)
    assert 'tilt the board by 30-45 degrees' in index.text
    assert 'tilt the board' in advice(result)
    assert abs(result.state.target_index - rig.target_index) < 3.0 * index.deviation


def test_a_ball_hardly_shows_the_index_and_the_verdict_says_so(rig_maker: Any) -> None:
    rng = np.random.default_rng(4)
    rig, depths = rig_maker('surface', rng)
    air = replace(RigState.of(rig), interfaces={})
    centre = -rig.rotation.T @ rig.translation / 2.0
    free = np.array([name.startswith(('target', 'interface')) for name in RigState.of(rig).names])
    information = np.diag([0.1**-2, 0.5**-2, 0.5**-2, 0.0])
    views = []
    for i in range(20):
        depth = rng.uniform(*depths)
        place = np.array([*(centre[:2] + rng.uniform(-0.3, 0.3, 2) * depth), depth])
        edges = rig.project(place + np.array([[-0.02, 0.0, 0.0], [0.02, 0.0, 0.0]]))
        blobs = tuple(
            Blob(
                pair.mean(axis=0) + rng.normal(scale=0.1, size=2),
                0.01 * np.eye(2),
                float(np.linalg.norm(pair[1] - pair[0]) + 0.14 * rng.normal()),
            )
            for pair in edges
        )
        views.append(ball_view(f'{i}', air, blobs, 0.04))
        pose = Pose(np.eye(3), place)
        information += view_information(RigState.of(rig), pose, views[-1], free, 0.1 / 0.5**0.5)
    guess = InterfaceGuess('interface', (1.0, 1.333))
    result = calibrate_interface(air, views, [guess], sigma=0.1 / 0.5**0.5)
    by_name = {verdict.name: verdict for verdict in verdicts(result)}
    index = by_name['target_index']
    bound = float(np.sqrt(np.linalg.inv(information)[0, 0]))
    assert bound > 0.01  # a board in ten mixed tilts gives 0.0015
    assert abs(index.value - rig.target_index) < 3.0 * index.deviation
    assert index.grade in (WEAK, PRIOR)
    assert 'hardly shows it' in index.text
    assert '--prior target_index' in index.text
    ruler = replace(guess, deviations={'target_index': 0.0005})
    known = verdicts(calibrate_interface(air, views, [ruler], sigma=0.1 / 0.5**0.5))[0]
    assert known.grade == DETERMINED
    assert 'by what you measured' in known.text


def test_mixed_boards_are_determined(rig_maker: Any, board_viewer: Any, guesser: Any) -> None:
    rng = np.random.default_rng(5)
    rig, depths = rig_maker('wall', rng)
    air = replace(RigState.of(rig), interfaces={})
    result = calibrate_interface(air, board_viewer(rig, depths, rng, tilts=TILTS), guesser(rig))
    own = [v for v in verdicts(result) if 'layer' not in v.text]
    assert {v.grade for v in own} == {DETERMINED}
    assert advice(result).startswith('Nothing must be done')


def test_ports_and_a_wall_behind_them_are_calibrated_together(
    rig_maker: Any, board_viewer: Any, guesser: Any
) -> None:
    square, ratios = 0.0, []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        rig, depths = rig_maker('housing', rng)
        air = replace(RigState.of(rig), interfaces={})
        views = board_viewer(rig, depths, rng, tilts=TILTS)
        result = calibrate_interface(air, views, guesser(rig))
        error = -RigState.of(rig).minus(result.state)
        own = [i for i, name in enumerate(result.state.names) if name in result.prior]
        wall = [i for i in own if result.state.names[i].startswith(('target', 'interface'))]
        wall = [i for i in wall if 'indices' not in result.state.names[i]]
        block = result.covariance[np.ix_(wall, wall)]
        square += error[wall] @ np.linalg.solve(block, error[wall])
        ratios.append(position_ratio(rig, depths, result.state, result.covariance, rng))
    assert square < chi2.ppf(0.99, 2 * len(wall))
    assert np.sqrt(np.mean(ratios)) < 1.3
    by_name = {verdict.name: verdict for verdict in verdicts(result)}
    assert by_name['target_index'].grade == DETERMINED
    assert by_name['interface.distance'].grade == DETERMINED
    assert by_name['left_port.distance'].grade == IRRELEVANT
    assert 'only shifts the rays' in by_name['left_port.distance'].text
    assert 'port' not in advice(result)


def test_a_ruler_narrows_the_distance(rig_maker: Any, board_viewer: Any, guesser: Any) -> None:
    rng = np.random.default_rng(6)
    rig, depths = rig_maker('surface', rng)
    views = board_viewer(rig, depths, rng, count=3)
    air = replace(RigState.of(rig), interfaces={})
    (guess,) = guesser(rig)
    free = calibrate_interface(air, views, [guess])
    ruler = replace(guess, distance=rig.interface.distance, deviations={'distance': 0.001})
    held = calibrate_interface(air, views, [ruler])
    assert held.deviation('interface.distance') < 0.001
    assert held.deviation('interface.distance') < 0.5 * free.deviation('interface.distance')
    assert held.deviation('target_index') < free.deviation('target_index')


def test_uncertain_cameras_widen_the_deviations(
    rig_maker: Any, board_viewer: Any, guesser: Any
) -> None:
    rng = np.random.default_rng(7)
    rig, depths = rig_maker('surface', rng)
    views = board_viewer(rig, depths, rng)
    air = replace(RigState.of(rig), interfaces={})
    known = ParameterCovariance(('left.fx', 'right.fx', 'translation.x'), np.diag([4, 4, 1e-6]))
    exact = calibrate_interface(air, views, guesser(rig))
    loose = calibrate_interface(air, views, guesser(rig), known)
    assert loose.deviation('target_index') > exact.deviation('target_index')
    assert 0 < loose.deviation('left.fx') <= 2.0


def test_outlying_points_are_left_out(rig_maker: Any, board_viewer: Any, guesser: Any) -> None:
    rng = np.random.default_rng(8)
    rig, depths = rig_maker('surface', rng)
    views = board_viewer(rig, depths, rng)
    for view in views[:3]:
        view.pixels[0][5:8] += [6.0, -4.0]
    air = replace(RigState.of(rig), interfaces={})
    result = calibrate_interface(air, views, guesser(rig))
    assert result.adjustment is not None
    assert not result.adjustment.inliers[0][0][5:8].any()
    assert result.adjustment.inliers[5][0].all()
    error = -RigState.of(rig).minus(result.state)
    assert abs(error[-1]) < 3.5 * result.deviation('interface.distance')


def test_a_bad_view_is_left_out_with_the_reason(
    rig_maker: Any, board_viewer: Any, guesser: Any
) -> None:
    rng = np.random.default_rng(8)
    rig, depths = rig_maker('surface', rng)
    views = board_viewer(rig, depths, rng)
    views[4] = replace(views[4], pixels=(views[4].pixels[0], views[4].pixels[1] + [9.0, 14.0]))
    air = replace(RigState.of(rig), interfaces={})
    result = calibrate_interface(air, views, guesser(rig))
    assert [one.name for one in result.dropped] == ['view 4']
    assert 'moved' in result.dropped[0].reason
    square = np.sum((result.state.interfaces['interface'].normal - rig.interface.normal) ** 2)
    assert np.sqrt(square) < np.radians(0.4)


def test_pictures_of_something_else_are_refused(
    rig_maker: Any, board_viewer: Any, guesser: Any
) -> None:
    rng = np.random.default_rng(8)
    rig, depths = rig_maker('surface', rng)
    views = board_viewer(rig, depths, rng, count=5)
    air = replace(RigState.of(rig), interfaces={})
    wrong = {
        'left and right are swapped': [replace(v, pixels=v.pixels[::-1]) for v in views],
        "check the board's size": [replace(v, points=1.1 * v.points) for v in views],
        'do not belong together': [
            replace(v, pixels=(v.pixels[0], views[(i + 2) % 5].pixels[1]))
            for i, v in enumerate(views)
        ],
    }
    for line, seen in wrong.items():
        with pytest.raises(CalibrationError, match=line):
            calibrate_interface(air, seen, guesser(rig))


def dry_rig(media: FlatInterface) -> StereoRig:
    """A rig before a plate, a dry window, or a tank that is seen through."""
    matrix = [[900.0, 0.0, 639.5], [0.0, 900.0, 479.5], [0.0, 0.0, 1.0]]
    camera = PinholeCamera(matrix, [-0.1, 0.05, 0.001, -0.001, 0.01], (1280, 960))
    rotation = exponential(np.array([0.0, 0.1, 0.0]))
    return StereoRig(camera, camera, rotation, -rotation @ [0.23, 0.0, 0.0], media)


@pytest.mark.parametrize('measured', [False, True])
@pytest.mark.parametrize(
    ('indices', 'thicknesses'),
    [
        ((1.0, 1.49, 1.0), (0.012,)),
        ((1.0, 1.49, 1.333, 1.49, 1.0), (0.01, 0.3, 0.01)),
        ((1.333, 1.49, 1.0), (0.01,)),
    ],
)
def test_what_ends_in_air_is_calibrated(
    board_viewer: Any,
    indices: tuple[float, ...],
    thicknesses: tuple[float, ...],
    measured: bool,
) -> None:
    rng = np.random.default_rng(3)
    media = FlatInterface([0.05, -0.04, 1.0], 0.3, indices, thicknesses)
    rig, reach = dry_rig(media), 0.3 + sum(thicknesses)
    views = board_viewer(rig, (reach + 0.2, reach + 0.6), rng, 8, 0.1, TILTS, EVERYWHERE)
    ruler: dict[str, Any] = {'distance': 0.3, 'deviations': {'distance': 0.001}}
    guess = InterfaceGuess('interface', indices, thicknesses, **(ruler if measured else {}))
    air = replace(RigState.of(rig), interfaces={})
    result = calibrate_interface(air, views, [guess])
    assert result.dropped == ()
    assert result.adjustment is not None
    assert result.adjustment.sigma == pytest.approx(0.1, rel=0.05)
    found = result.state.interfaces['interface']
    assert found.indices[-1] == 1.0
    by_name = {verdict.name: verdict for verdict in verdicts(result)}
    assert 'target_index' not in by_name
    angle = np.arccos(min(1.0, float(found.normal @ media.normal)))
    assert angle < 4.0 * result.deviation('interface.normal.0')
    if len(indices) == 3 and indices[0] == 1.0:
        assert 'only shifts the rays' in by_name['interface.normal.0'].text
    else:
        assert angle < np.radians(0.1)
    distance = by_name['interface.distance']
    if indices[0] == 1.0:
        assert distance.grade == IRRELEVANT
        assert 'does not matter' in distance.text
    else:
        assert distance.value == pytest.approx(0.3, abs=0.004)
    seen = rig.project(np.array([[0.1, 0.05, reach + 0.3]]))
    where = triangulate(result.state.rig(), *seen).points[0]
    np.testing.assert_allclose(where, [0.1, 0.05, reach + 0.3], atol=1e-3)


@pytest.mark.parametrize('seed', [3, 4, 5])
def test_an_index_known_to_be_about_one_ends_at_one_or_above(board_viewer: Any, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rig = dry_rig(FlatInterface([0.05, -0.04, 1.0], 0.3, (1.333, 1.49, 1.0), (0.01,)))
    views = board_viewer(rig, (0.5, 0.9), rng, 8, 0.1, TILTS, EVERYWHERE)
    guess = InterfaceGuess(
        'interface', (1.333, 1.49, 1.0), (0.01,), deviations={'target_index': 0.001}
    )
    result = calibrate_interface(replace(RigState.of(rig), interfaces={}), views, [guess])
    index = verdicts(result)[0]
    assert 1.0 <= index.value < 1.0 + 4.0 * index.deviation
    assert 0.0 < index.deviation < 0.001


@pytest.mark.parametrize(
    ('change', 'scale', 'line'),
    [
        ({'distance': 800.0, 'deviations': {'distance': 5.0}}, 1.0, 'with distance 0.8 m'),
        ({'thicknesses': (12.0,)}, 1.0, 'with thickness 0.012 m'),
        ({'deviations': {'target_index': 0.0005}}, 1.2, 'a board about 0.83 times as large'),
    ],
)
def test_what_would_explain_the_pictures_is_named(
    board_viewer: Any, change: dict[str, Any], scale: float, line: str
) -> None:
    rng = np.random.default_rng(3)
    rig = dry_rig(FlatInterface([0.05, -0.04, 1.0], 0.8, (1.0, 1.49, 1.333), (0.012,)))
    views = board_viewer(rig, (1.0, 1.3), rng, 6, 0.1, TILTS, EVERYWHERE)
    views = [replace(view, points=scale * view.points) for view in views]
    guess = replace(InterfaceGuess('interface', (1.0, 1.49, 1.333), (0.012,)), **change)
    with pytest.raises(CalibrationError, match=line):
        calibrate_interface(replace(RigState.of(rig), interfaces={}), views, [guess])


@pytest.mark.parametrize('deviations', [{}, {'target_index': 0.0005}])
def test_pictures_taken_in_air_are_told(board_viewer: Any, deviations: dict[str, float]) -> None:
    rng = np.random.default_rng(3)
    wet = dry_rig(FlatInterface([0.0, 0.0, 1.0], 0.5, (1.0, 1.333)))
    dry = StereoRig(wet.left, wet.right, wet.rotation, wet.translation)
    views = board_viewer(dry, (0.7, 1.0), rng, 6, 0.1, TILTS, EVERYWHERE)
    guess = InterfaceGuess('interface', (1.0, 1.333), deviations=deviations)
    with pytest.raises(CalibrationError, match=r'taken in air|that of air and of no liquid'):
        calibrate_interface(replace(RigState.of(wet), interfaces={}), views, [guess])


def test_views_that_repeat_each_other_count_once(
    rig_maker: Any, board_viewer: Any, guesser: Any
) -> None:
    rng = np.random.default_rng(5)
    rig, depths = rig_maker('surface', rng)
    air = replace(RigState.of(rig), interfaces={})
    views = board_viewer(rig, depths, rng, tilts=TILTS)
    again = [
        replace(view, pixels=tuple(p + rng.normal(scale=0.1, size=p.shape) for p in view.pixels))
        for view in views
    ]
    once = calibrate_interface(air, views, guesser(rig))
    twice = calibrate_interface(air, [*views, *again], guesser(rig))
    assert sum('repeats' in one.reason for one in twice.dropped) == len(views)
    assert twice.deviation('target_index') == pytest.approx(once.deviation('target_index'))


def test_same_optimum_as_scipy(rig_maker: Any, board_viewer: Any, guesser: Any) -> None:
    rng = np.random.default_rng(9)
    rig, depths = rig_maker('surface', rng)
    views = board_viewer(rig, depths, rng, count=4)
    air = replace(RigState.of(rig), interfaces={})
    (guess,) = guesser(rig)
    result = calibrate_interface(air, views, [guess], robust=False, sigma=0.1)
    fit = result.adjustment
    assert fit is not None
    first = len(result.state.names) - 4

    def residuals(x: np.ndarray) -> np.ndarray:
        state = result.state.plus(np.concatenate([np.zeros(first), x[:4]]))
        moved = state.rig()
        parts = []
        for i, (view, pose) in enumerate(zip(views, fit.poses, strict=True)):
            shift = x[4 + 6 * i : 10 + 6 * i]
            turned = Pose(_rotation(shift[:3]) @ pose.rotation, pose.translation + shift[3:])
            seen = moved.project(turned.apply(view.points))
            parts += [((a - b) / 0.1).ravel() for a, b in zip(view.pixels, seen, strict=True)]
        normal = state.interfaces['interface'].normal
        parts.append(np.array([(state.target_index - 1.333) / 0.1, *(normal[:2] / 0.5)]))
        return np.concatenate(parts)

    better = least_squares(residuals, np.zeros(4 + 24), x_scale='jac', xtol=1e-14, ftol=1e-14)
    assert 2.0 * better.cost == pytest.approx(np.sum(residuals(np.zeros(28)) ** 2), rel=1e-5)
    spread = np.sqrt(np.diag(np.linalg.inv(better.jac.T @ better.jac)))[:4]
    assert np.abs(better.x[:4] / spread).max() < 0.02
    own = np.sqrt(np.diag(result.covariance))[first:]
    np.testing.assert_allclose(own, spread, rtol=0.01)


def _rotation(vector: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vector).as_matrix()


def test_ruler_alone_is_enough(rig_maker: Any) -> None:
    rig, _ = rig_maker('surface', np.random.default_rng(1))
    air = replace(RigState.of(rig), interfaces={})
    guess = InterfaceGuess(
        'interface', (1.0, 1.333), distance=0.8, deviations={'distance': 0.003, 'normal': 0.01}
    )
    result = calibrate_interface(air, [], [guess])
    assert result.state.interfaces['interface'].distance == 0.8
    assert result.deviation('interface.distance') == pytest.approx(0.003)
    assert any('what you measured' in verdict.text for verdict in verdicts(result))


@pytest.mark.parametrize(
    ('guesses', 'line'),
    [
        ([InterfaceGuess('interface', (1.0, 1.333))], 'must be measured by hand'),
        ([], 'one shared surface, or a port for each camera'),
        (
            [
                InterfaceGuess('left_port', (1.0, 1.5, 1.33), (0.01,), 0.1),
                InterfaceGuess('right_port', (1.0, 1.5, 1.34), (0.01,), 0.1),
            ],
            'different media',
        ),
        (
            [
                InterfaceGuess('interface', (1.0, 1.333), (), 0.8),
                InterfaceGuess('left_port', (1.0, 1.5, 1.33), (0.01,), 0.1),
                InterfaceGuess('right_port', (1.0, 1.5, 1.33), (0.01,), 0.1),
            ],
            'it is the same medium',
        ),
    ],
)
def test_unknown_interfaces_are_refused(
    rig_maker: Any, guesses: list[InterfaceGuess], line: str
) -> None:
    rig, _ = rig_maker('surface', np.random.default_rng(1))
    with pytest.raises(CalibrationError, match=line):
        calibrate_interface(replace(RigState.of(rig), interfaces={}), [], guesses)
