"""A real tank: four planes of dots seen by two cameras through air, glass and water.

Run as `python bench/triangulation/multiplane.py [FOLDER]`, FOLDER being the OpenPTV multiplane
example (see its SOURCE.md; the default is ../shared/data/openptv-multiplane). It prints the 3-D
errors with the published calibration, the errors on a plane that the refit has not seen, and the
refractive index left free with its uncertainty. The fits are those of the tests,
`test/scenes/multiplane_fits.py`.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test' / 'scenes'))

from figures import Column, Figures
from multiplane_fits import PLANES, Media, free_index, located, published, refit, rms

DATA = Path(__file__).resolve().parents[3] / 'shared' / 'data' / 'openptv-multiplane'


def main() -> None:
    """Print the tables."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else DATA
    poses = [published(folder, camera) for camera in (1, 2)]
    found = Figures('triangulation/multiplane')
    table = found.table('errors', '', Column('3-D RMS, mm', '.3f'))
    for method in ('refractive', 'paper', 'straight'):
        error = rms(located(folder, poses, PLANES, Media(), method))
        table.row(f'published calibration, `{method}`, 1620 dots', error)
    for name, media in (('bent rays', Media()), ('a pinhole, any pose', Media(bent=False))):
        fitted = refit(folder, (1, 2, 4), media)[0]
        error = rms(located(folder, fitted, (3,), media, 'refractive'))
        table.row(f'{name}, refit on planes 1, 2, 4; plane 3, unseen', error)
    free = free_index(folder)
    table = found.table(
        'index', "the water's index left free", Column('index', '.3f'), Column('95 %, +-', '.3f')
    )
    table.row('refit on all planes', free.index, free.interval)
    table = found.table('deviations', 'errs as one', Column('standard deviation', '.4f'))
    for words, name in (
        ('a dot', 'dots'),
        ('an image (one camera, one plane: 405 dots)', 'images'),
        ('a plane, in both cameras alike', 'planes'),
    ):
        table.row(words, getattr(free, name))
    found.keep()


if __name__ == '__main__':
    main()
