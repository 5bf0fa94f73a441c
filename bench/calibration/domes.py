"""Truth of dome calibrations: simulated rigs, what is found of their centres, and positions then.

python bench/calibration/domes.py [--rigs 50] [--views 10] [--known-index SD]

Two cameras with wide (equidistant) lenses 0.12 m apart behind domes of 40 to 60 mm, whose centres
lie 0 to 5 mm off the cameras; a board at 0.25 to 0.6 m. The cameras are known, and of the domes
radius, wall and glass.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

import numpy as np
import truth

from binopos_ros.calibration.interface.calibrate import calibrate_interface
from binopos_ros.calibration.interface.guesses import DomeGuess
from binopos_ros.optics import DomePort, PinholeCamera, StereoRig
from binopos_ros.optics.rig_state import RigState, exponential
from figures import Column, Figures

DEPTHS = (0.25, 0.6)
ASIDE = (0.8, 0.6)
BASELINE, TURN = 0.12, 0.05
FARTHEST = 5e-3
#: Radius, wall and glass: from the maker's drawing.
EXACT = {'radius': 1e-6, 'thicknesses.0': 1e-6, 'indices.1': 1e-6}
#: 95 % quantile of chi^2 with 6 degrees of freedom, three for each centre.
REGION = 12.592


def make_rig(rng: np.random.Generator) -> StereoRig:
    """A rig with a dome before each camera."""
    focal = rng.uniform(580.0, 660.0)
    matrix = np.array([[focal, 0.0, 639.5], [0.0, focal, 479.5], [0.0, 0.0, 1.0]])
    lens = PinholeCamera(matrix, (0.012, -0.006, 0.002, -0.0003), truth.SIZE, 'equidistant')
    water = rng.uniform(1.325, 1.345)
    domes = []
    for _ in range(2):
        away = rng.standard_normal(3)
        centre = rng.uniform(0.0, FARTHEST) * away / np.linalg.norm(away)
        domes.append(
            DomePort(centre, rng.uniform(0.04, 0.06), rng.uniform(0.003, 0.008), (1, 1.49, water))
        )
    rotation = exponential(np.array([0.0, TURN, 0.0]))
    return StereoRig(lens, lens, rotation, -rotation @ [BASELINE, 0.0, 0.0], None, *domes)


def guesses_for(rig: StereoRig, known_index: float, rng: np.random.Generator) -> list[DomeGuess]:
    """What a user knows: the domes themselves, the water about or to `known_index`, no centre."""
    water = 1.333 if known_index == 0.0 else float(rig.target_index) + known_index * rng.normal()
    more = {'target_index': known_index} if known_index else {}
    return [
        DomeGuess(
            place,
            (1.0, dome.indices[1], water),
            dome.thicknesses,
            dome.radius,
            deviations={**EXACT, **more},
        )
        for place, dome in (('left_port', rig.left_port), ('right_port', rig.right_port))
    ]


def measure(rigs: int, views: int, known_index: float) -> None:
    """Errors, stated deviations, coverage and positions."""
    way = f'.index-{known_index:g}' if known_index else ''
    kept = Figures(
        f'calibration/domes{way}', rigs=rigs, views=views, index_known_to=known_index or None
    )
    errors, stated, regions, squares = [], [], [], []
    for seed in range(rigs):
        rng = np.random.default_rng(90_000 + seed)
        rig = make_rig(rng)
        known = RigState.of(rig)
        seen = truth.see_boards(rig, DEPTHS, rng, views, ASIDE)
        result = calibrate_interface(
            replace(known, interfaces={}), seen, guesses_for(rig, known_index, rng)
        )
        error = -known.minus(result.state)
        own = [i for i, name in enumerate(result.state.names) if '.centre.' in name]
        block = result.covariance[np.ix_(own, own)]
        errors.append(error[own].reshape(2, 3))
        stated.append(np.sqrt(np.diag(block)).reshape(2, 3))
        regions.append(error[own] @ np.linalg.solve(block, error[own]))
        squares.append(truth.position_squares(rig, DEPTHS, result.state, result.covariance, rng))

    def rms(values: list[np.ndarray]) -> tuple[float, float]:
        square = np.mean(np.square(values), axis=(0, 1))
        return 1e3 * float(np.sqrt(square[:2].mean())), 1e3 * float(np.sqrt(square[2]))

    error_square, bound, exact = np.mean(squares, axis=0)
    print(f'{truth.NOISE} px')
    table = kept.table(
        'centres', "a dome's centre", Column('across (mm)', '.3f'), Column('along (mm)', '.3f')
    )
    for name, found in (('error, RMS', rms(errors)), ('stated', rms(stated))):
        table.row(name, *found)
    across, along = np.abs(errors)[..., :2].max(), np.abs(errors)[..., 2].max()
    table.row('error, largest', 1e3 * across, 1e3 * along)
    table = kept.table('whole', '', Column('', '.2f'))
    table.row('in the 95 % region, %', 100 * np.mean(np.less(regions, REGION)))
    table.row('normalised square / 6', np.mean(regions) / 6)
    table.row('positions, times their bound', np.sqrt(error_square / bound))
    table.row("positions, times an exact rig's", np.sqrt(error_square / exact))
    kept.keep()


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rigs', type=int, default=50)
    parser.add_argument('--views', type=int, default=10)
    parser.add_argument('--known-index', type=float, default=0.0, metavar='SD')
    arguments = parser.parse_args()
    measure(arguments.rigs, arguments.views, arguments.known_index)


if __name__ == '__main__':
    main()
