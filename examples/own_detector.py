"""A detector of one's own before the suite's triangulation and smoothing.

Any function will do that gives a centre in pixels, and how sure it is of it.
"""

from pathlib import Path

import cv2
import numpy as np

from binopos_ros import Tracker
from binopos_ros.bag import BagReader
from binopos_ros.bag.messages import stamp_of
from binopos_ros.detection import decode
from binopos_ros.detection.images import image_of
from binopos_ros.optics import StereoRig

BAG = Path(__file__).parent.parent / 'bags' / 'demo'
PAIRS = 12


def centre_of_red(bgr):
    """Centre (px) of the largest patch that is redder than green, and its covariance (px^2)."""
    red = cv2.subtract(bgr[..., 2], bgr[..., 1]) > 60
    _, _, stats, centres = cv2.connectedComponentsWithStats(red.astype(np.uint8))
    return centres[1 + stats[1:, cv2.CC_STAT_AREA].argmax()], 0.25 * np.eye(2)


tracker = Tracker(StereoRig.load(BAG))
pictures = {}
with BagReader(BAG) as bag:
    topics = [f'/stereo/{side}/image_raw/compressed' for side in ('left', 'right')]
    for record in bag.messages(topics=topics):
        message = bag.decode(record)
        frame = decode(image_of(message))
        bgr = frame.window(0, 0, frame.width, frame.height)
        pictures.setdefault(stamp_of(message), {})[record.topic] = centre_of_red(bgr)
        if len(pictures) > PAIRS:
            break
for stamp, seen in pictures.items():
    if len(seen) == len(topics):
        (left, left_cov), (right, right_cov) = (seen[topic] for topic in topics)
        tracked = tracker.step(stamp / 1e9, left, right, left_cov, right_cov)
print(f'raw {tracked.position.round(4)} m, smoothed {tracked.pose.position.round(4)} m')
