"""The red target in an image: found, told from its likes, and measured (the paper's Sec. 2.5)."""

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
