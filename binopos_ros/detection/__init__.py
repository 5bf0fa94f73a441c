"""The red target in an image: found, told from its likes, and measured (the paper's Sec. 2.5).

>>> import cv2, numpy as np
>>> image = np.full((240, 320, 3), (120, 110, 90), np.uint8)
>>> image = cv2.circle(image, (150, 100), 20, (40, 40, 200), -1, cv2.LINE_AA)
>>> target = detect(image)
>>> print(target.centre.round(), round(target.diameter))
[150. 100.] 41
"""

from __future__ import annotations

from .decoders import JPEG_DECODER
from .detector import Detector, detect
from .disc import estimate_normal
from .errors import DetectionError
from .images import ENCODINGS, Frame, JpegImage, RawImage, decode
from .options import DetectorOptions
from .target import Candidate, Detection, Ellipse, Target

__all__ = [
    'ENCODINGS',
    'JPEG_DECODER',
    'Candidate',
    'Detection',
    'DetectionError',
    'Detector',
    'DetectorOptions',
    'Ellipse',
    'Frame',
    'JpegImage',
    'RawImage',
    'Target',
    'decode',
    'detect',
    'estimate_normal',
]
