"""The pictures of docs/tutorial.md: how to hold the board, in air and through the water.

    python docs/figures/tutorial.py DRY WET

DRY and WET are the bags that the tutorial has `binopos simulate` make.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

from binopos_ros.bag import BagReader

OUT = Path(__file__).with_name('tutorial.jpg')
TOPIC = '/stereo/left/image_raw/compressed'
BOARD = (9, 6)
#: Pictures of each bag, and the width of one, px.
SHOWN, WIDTH = (0, 4, 7, 11), 300


def row(bag: Path) -> np.ndarray:
    """Pictures of a bag beside each other, with the corners of the board."""
    shown = []
    with BagReader(bag) as reader:
        for number, record in enumerate(reader.messages([TOPIC])):
            if number in SHOWN:
                data = np.frombuffer(bytes(reader.decode(record).data), np.uint8)
                picture = cv2.imdecode(data, cv2.IMREAD_COLOR)
                grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
                found, corners = cv2.findChessboardCornersSB(grey, BOARD)
                cv2.drawChessboardCorners(picture, BOARD, corners, found)
                height = round(WIDTH * picture.shape[0] / picture.shape[1])
                shown.append(cv2.resize(picture, (WIDTH, height), interpolation=cv2.INTER_AREA))
    return np.hstack(shown)


def main() -> None:
    dry, wet = map(Path, sys.argv[1:3])
    cv2.imwrite(str(OUT), np.vstack([row(dry), row(wet)]), [cv2.IMWRITE_JPEG_QUALITY, 85])
    print(f'written: {OUT.name}')


if __name__ == '__main__':
    main()
