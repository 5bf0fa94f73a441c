"""How far off coloured discs are told from a red one.

Run as `python docs/figures/detection_hues.py`. Writes `detection_hues.png` beside this file, and
prints the share of ten waters in which a disc of each colour, alone in the picture, is taken for
the target.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test' / 'scenes'))

import matplotlib as mpl
import numpy as np

from binopos_ros.detection import Detector
from waters import OTHERS, RED, WATERS, tank

mpl.use('Agg')
import matplotlib.pyplot as plt

WAYS = np.arange(0.0, 1.61, 0.2)


def main() -> int:
    colours = {'red': RED, **OTHERS}
    figure, axes = plt.subplots(figsize=(7, 4))
    print('| way | ' + ' | '.join(f'{way:.1f}' for way in WAYS) + ' |')
    print('|---|' + '---|' * len(WAYS))
    for name, colour in colours.items():
        shares = []
        for way in WAYS:
            taken = [
                Detector().detect(tank(water, ((160, 120), 18, colour), way=way)).target
                for water in WATERS
            ]
            shares.append(np.mean([each is not None for each in taken]))
        line = 'hotpink' if name == 'pink' else 'gold' if name == 'yellow' else name
        axes.plot(WAYS, shares, 'o-', color=line, label=name)
        print(f'| {name} | ' + ' | '.join(f'{share:.1f}' for share in shares) + ' |')
    axes.set_xlabel('way through the water, in lengths over which green falls to 1/e')
    axes.set_ylabel('share of ten waters in which it is taken')
    axes.legend()
    figure.tight_layout()
    figure.savefig(Path(__file__).with_suffix('.png'), dpi=110)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
