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

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test' / 'scenes'))

from multiplane_fits import PLANES, Media, free_index, located, published, refit, rms

DATA = Path(__file__).resolve().parents[3] / 'shared' / 'data' / 'openptv-multiplane'


def main() -> None:
    """Print the tables."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else DATA
    poses = [published(folder, camera) for camera in (1, 2)]
    print('3-D RMS of 1620 dots, mm            published calibration')
    for method in ('refractive', 'paper', 'straight'):
        print(f'  {method:<33}{rms(located(folder, poses, PLANES, Media(), method)):.3f}')
    print('refit on planes 1, 2, 4             plane 3, unseen')
    for name, media in (('bent', Media()), ('pinhole', Media(bent=False))):
        fitted = refit(folder, (1, 2, 4), media)[0]
        print(f'  {name:<33}{rms(located(folder, fitted, (3,), media, "refractive")):.3f}')
    found = free_index(folder)
    print(f'water index left free, 95 %         {found.index:.4f} +- {found.interval:.4f}')
    print('  standard deviation if one erred as one:')
    for name in ('dots', 'images', 'planes'):
        print(f'  {name:<33}{getattr(found, name):.4f}')


if __name__ == '__main__':
    main()
