"""The picture of the README: both images of the demo bag with the target, and the track.

python docs/figures/overview.py
"""

from __future__ import annotations

import csv
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib as mpl

mpl.use('Agg')
import matplotlib.pyplot as plt
import numpy as np

from binopos_ros.bag import BagReader
from binopos_ros.bag.messages import position_of, stamp_of
from binopos_ros.detection import Detector, JpegImage, decode
from binopos_ros.detection.overlay import draw

BAG = Path(__file__).resolve().parents[2] / 'bags' / 'demo'
FRAME = 60


def pictures() -> list[np.ndarray]:
    """Left and right image, blue-green-red, with what the detector drew on them."""
    drawn = []
    with BagReader(BAG) as reader:
        for side in ('left', 'right'):
            records = reader.messages([f'/stereo/{side}/image_raw/compressed'])
            message = next(reader.decode(r) for k, r in enumerate(records) if k == FRAME)
            frame = decode(JpegImage(message.data))
            picture = frame.window(0, 0, frame.width, frame.height)
            drawn.append(draw(picture, Detector().detect_in(frame)))
    return drawn


def track() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Seconds (N,), errors of target/pose (N, 3) m, their standard deviations (N, 3) m."""
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / 'out.csv'
        words = ['process', BAG, '-o', table.with_name('out.mcap'), '--csv', table]
        subprocess.run([sys.executable, '-m', 'binopos_ros', *map(str, words)], check=True)
        with table.open() as stream:
            rows = list(csv.DictReader(stream))
    with BagReader(BAG) as reader:
        messages = [reader.decode(r) for r in reader.messages(['/stereo/truth/pose'])]
    truth = {stamp_of(message): position_of(message) for message in messages}
    stamps = [int(row['stamp'].replace('.', '')) for row in rows]
    found = np.array([[float(row[axis]) for axis in 'xyz'] for row in rows])
    spread = np.array([[float(row[f's{axis}']) for axis in 'xyz'] for row in rows])
    errors = found - np.array([truth[stamp] for stamp in stamps])
    return np.array([stamp - stamps[0] for stamp in stamps]) * 1e-9, errors, spread


def main() -> None:
    figure, axes = plt.subplots(1, 3, figsize=(13, 3.4), width_ratios=(4, 4, 4))
    for axis, picture, side in zip(axes[:2], pictures(), ('left', 'right'), strict=True):
        axis.imshow(picture[..., ::-1])
        axis.set_title(f'{side} camera')
        axis.set_axis_off()
    seconds, errors, spread = track()
    for k, (name, colour) in enumerate(zip('xyz', ('C0', 'C1', 'C2'), strict=True)):
        axes[2].plot(seconds, errors[:, k] * 1e3, color=colour, label=name)
        low, high = (errors[:, k] + sign * 2 * spread[:, k] for sign in (-1, 1))
        axes[2].fill_between(seconds, low * 1e3, high * 1e3, color=colour, alpha=0.15, lw=0)
    axes[2].axhline(0, color='grey', lw=0.5)
    axes[2].set_ylim(-4, 4)
    axes[2].set_xlabel('s')
    axes[2].set_ylabel('mm')
    axes[2].set_title('target/pose minus truth, and 2 sigma')
    axes[2].legend(loc='upper right', ncols=3)
    figure.tight_layout()
    figure.savefig(Path(__file__).with_suffix('.png'), dpi=90)


if __name__ == '__main__':
    main()
