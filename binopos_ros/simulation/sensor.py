"""From light to the bytes a camera sends: blur, noise, rounding, and the picture's encoding."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
from numpy.typing import NDArray

from binopos_ros.simulation.errors import SimulationError

Picture = NDArray[np.uint8]
Image = NDArray[np.float32]

#: Encodings of the pictures: the camera's JPEG, or raw ones by their ROS names.
ENCODINGS = ('jpeg', 'bgr8', 'rgb8', 'yuv422_yuy2', 'bayer_rggb8')

MID_GREY = 128.0


@dataclasses.dataclass(frozen=True)
class Sensor:
    """A colour sensor with a linear response.

    Attributes:
        noise: standard deviation at mid grey (128), grey levels; half its variance is shot noise,
            which grows with the light, half is read-out noise.
        exposure: grey levels per grey level of the scene's light.
        blur: standard deviation of the lens's Gaussian blur, px.
        quality: of the JPEG, 1 to 100.
        encoding: one of ENCODINGS.
    """

    noise: float = 1.5
    exposure: float = 1.2
    blur: float = 0.6
    quality: int = 90
    encoding: str = 'jpeg'

    def __post_init__(self) -> None:
        for name in ('noise', 'exposure', 'blur'):
            value = getattr(self, name)
            if not (np.isfinite(value) and 0 <= value <= 50):
                msg = f"the sensor's {name} is {value!r}: give 0 to 50"
                raise SimulationError(msg)
        if not 1 <= self.quality <= 100:
            msg = f'the JPEG quality is {self.quality!r}: give 1 to 100'
            raise SimulationError(msg)
        if self.encoding not in ENCODINGS:
            msg = f'no encoding is called {self.encoding!r}: choose one of {", ".join(ENCODINGS)}'
            raise SimulationError(msg)

    @property
    def blur_radius(self) -> int:
        """How far the blur reaches, px."""
        return int(np.ceil(4 * self.blur))

    def blurred(self, light: Image) -> Image:
        """The lens's blur; the border is repeated."""
        if not self.blur:
            return light
        side = 2 * self.blur_radius + 1
        return np.asarray(
            cv2.GaussianBlur(light, (side, side), self.blur, borderType=cv2.BORDER_REPLICATE),
            np.float32,
        )

    def noise_level(self, light: Image) -> Image:
        """Standard deviation of the noise for each sample of light, grey levels."""
        variance = np.maximum(light, 0) * np.float32(self.noise**2 / (2 * MID_GREY))
        variance += np.float32(self.noise**2 / 2)
        return np.sqrt(variance)

    def read_out(self, light: Image, level: Image, rng: np.random.Generator) -> Picture:
        """Noisy, rounded grey levels of 8 bits.

        Args:
            light: (H, W, 3) grey levels.
            level: (H, W, 3) standard deviation of their noise.
            rng: where the noise is drawn from.
        """
        draw = rng.standard_normal(light.shape, dtype=np.float32)
        draw *= level
        return np.asarray(cv2.add(light, draw, dtype=cv2.CV_8U), np.uint8)

    def encode(self, picture: Picture) -> bytes:
        """The picture (blue, green, red) as the bytes of a message."""
        return _ENCODERS[self.encoding](picture, self.quality)


def bytes_per_pixel(encoding: str) -> int:
    """Bytes of one pixel of a raw encoding."""
    return {'bgr8': 3, 'rgb8': 3, 'yuv422_yuy2': 2, 'bayer_rggb8': 1}[encoding]


def _jpeg(picture: Picture, quality: int) -> bytes:
    good, data = cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not good:
        msg = f'OpenCV could not write a JPEG of {picture.shape[1]}x{picture.shape[0]}'
        raise SimulationError(msg)
    return data.tobytes()


def _yuyv(picture: Picture, _quality: int) -> bytes:
    # BT.601 with the narrow range of video, as webcams send it; two pixels share their chroma.
    blue, green, red = (picture[..., channel].astype(np.float32) for channel in range(3))
    luma = 16 + (65.481 * red + 128.553 * green + 24.966 * blue) / 255
    cb = 128 + (-37.797 * red - 74.203 * green + 112.0 * blue) / 255
    cr = 128 + (112.0 * red - 93.786 * green - 18.214 * blue) / 255
    packed = np.empty((*picture.shape[:2], 2), np.float32)
    packed[..., 0] = luma
    packed[:, 0::2, 1] = (cb[:, 0::2] + cb[:, 1::2]) / 2
    packed[:, 1::2, 1] = (cr[:, 0::2] + cr[:, 1::2]) / 2
    return np.clip(np.rint(packed), 0, 255).astype(np.uint8).tobytes()


def _bayer(picture: Picture, _quality: int) -> bytes:
    mosaic = picture[..., 1].copy()
    mosaic[0::2, 0::2] = picture[0::2, 0::2, 2]
    mosaic[1::2, 1::2] = picture[1::2, 1::2, 0]
    return mosaic.tobytes()


_ENCODERS = {
    'jpeg': _jpeg,
    'bgr8': lambda picture, _: picture.tobytes(),
    'rgb8': lambda picture, _: picture[..., ::-1].tobytes(),
    'yuv422_yuy2': _yuyv,
    'bayer_rggb8': _bayer,
}
