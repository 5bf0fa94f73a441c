"""Pictures of balls and discs as cameras see them, with the truth in closed form.

The outline is a circle or an ellipse whose centre is given; how it is lit, what covers it and how
the camera takes it are added one by one. Nothing of `binopos_ros` is used.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np

FINE = 5
"""Sub-pixels per pixel and side."""


@dataclass(frozen=True)
class Look:
    """How a target is seen. Colours are blue, green, red, in grey levels of linear light.

    light is the direction towards the lamp (unit, z towards the camera) and ambient the share of
    light from everywhere else; without a lamp the target is flat. highlight is the strength of
    its gloss, motion the length of its path during the exposure (px, along u), vignetting what is
    lost in the corner, caustics and texture the unevenness of light and of ground, veil the share
    that the water scatters in, hidden the share of the diameter that a plank covers.
    """

    colour: tuple[float, float, float] = (40.0, 36.0, 190.0)
    ground: tuple[float, float, float] = (140.0, 135.0, 90.0)
    ratio: float = 1.0
    light: tuple[float, float, float] | None = None
    ambient: float = 0.35
    highlight: float = 0.0
    blur: float = 0.8
    motion: float = 0.0
    vignetting: float = 0.0
    caustics: float = 0.0
    texture: float = 0.0
    veil: float = 0.0
    hidden: float = 0.0
    gamma: bool = False
    gain: float = 1.0
    noise: float = 2.0


class Taken(NamedTuple):
    """A picture (height, width, 3) uint8 and where the outline's centre is, px."""

    picture: np.ndarray
    centre: np.ndarray


PLANK = (70.0, 66.0, 58.0)


def take(look: Look, diameter: float, rng: np.random.Generator) -> Taken:
    """Take a picture of a target of that diameter, px, at a random place and turn."""
    size = int(diameter * 1.5 + 44) // 2 * 2
    centre = (size - 1) / 2 + rng.uniform(-3, 3, 2)
    turn = rng.uniform(0, 2 * np.pi)
    along = (np.arange(size * FINE) + 0.5) / FINE - 0.5
    x, y = along - centre[0], (along - centre[1])[:, None]
    across, down = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
    radius = diameter / 2
    p, q = across / radius, down / (radius * look.ratio)
    squared = p * p + q * q
    share = (squared < 1).astype(np.float32)
    light = np.ones_like(share)
    gloss = np.zeros_like(share)
    if look.light is not None:
        lamp = np.array(look.light) / np.linalg.norm(look.light)
        depth = np.sqrt(np.clip(1 - squared, 0, None))
        towards = p * lamp[0] + q * lamp[1] + depth * lamp[2]
        light = look.ambient + (1 - look.ambient) * np.clip(towards, 0, None)
        half = lamp + np.array([0.0, 0.0, 1.0])
        half /= np.linalg.norm(half)
        gloss = look.highlight * np.clip(p * half[0] + q * half[1] + depth * half[2], 0, 1) ** 40
    ground = np.ones((size, size))
    if look.texture:
        rough = cv2.GaussianBlur(rng.standard_normal((size, size)), (0, 0), 2.5)
        ground = ground + look.texture / 100 * rough / rough.std()
    if look.caustics:
        waves = cv2.GaussianBlur(rng.standard_normal((size, size)), (0, 0), 5.0)
        bands = look.caustics * np.exp(-((waves / waves.std()) ** 2) * 4)
        ground, light = ground + bands, light * (1 + enlarged(bands))
    share, light = share[..., None], light[..., None]
    fine = enlarged(ground)[..., None] * np.array(look.ground) * (1 - share)
    fine = fine + share * (light * np.array(look.colour) + gloss[..., None] * 255)
    if look.hidden:
        plank = (p < 2 * look.hidden - 1)[..., None]
        fine = np.where(plank, np.array(PLANK), fine)
    fine = fine * (1 - look.veil) + look.veil * np.array(look.ground)
    fine = cv2.GaussianBlur(fine.astype(np.float32), (0, 0), look.blur * FINE)
    if look.motion:
        fine = cv2.blur(fine, (max(round(look.motion * FINE), 1) | 1, 1))
    linear = fine.reshape(size, FINE, size, FINE, 3).mean((1, 3)) * look.gain
    if look.vignetting:
        middle = rng.uniform(0.2, 0.8, 2) * size + rng.choice([-1, 1], 2) * size
        px = np.arange(size)
        far = np.hypot(px - middle[0], (px - middle[1])[:, None]) / (2.5 * size)
        linear = linear * (1 - look.vignetting * far**2)[..., None]
    if look.gamma:
        linear = 255 * np.clip(linear / 255, 0, 1) ** (1 / 2.2)
    noisy = linear + look.noise * rng.standard_normal(linear.shape)
    return Taken(np.clip(np.round(noisy), 0, 255).astype(np.uint8), centre)


def enlarged(plain: np.ndarray) -> np.ndarray:
    """The same at the sub-pixels."""
    shape = (plain.shape[1] * FINE, plain.shape[0] * FINE)
    return cv2.resize(plain, shape, interpolation=cv2.INTER_LINEAR)


DISC = Look()
BALL = Look(light=(0.5, 0.0, 0.85), ambient=0.6, ground=(150.0, 140.0, 70.0))

LOOKS = {
    'disc': DISC,
    'tilted disc': replace(DISC, ratio=0.6),
    'ball': BALL,
    'ball, strong light': replace(BALL, ambient=0.35),
    'ball, highlight': replace(BALL, highlight=0.8),
    'ball, dark limb on dark water': replace(
        BALL, ambient=0.25, light=(0.8, 0.0, 0.6), ground=(40.0, 36.0, 18.0)
    ),
    'motion': replace(DISC, motion=4.0),
    'vignetting': replace(DISC, vignetting=0.8),
    'caustics': replace(BALL, caustics=0.25),
    'veil': replace(DISC, veil=0.6),
    'texture': replace(DISC, texture=5.0),
    'gamma': replace(BALL, gamma=True),
    'dim': replace(DISC, gain=0.22, noise=4.0),
}
HIDDEN = {
    'a third hidden': replace(DISC, hidden=0.33),
    'ball, a third hidden': replace(BALL, hidden=0.33),
}


def plain_script(picture: np.ndarray) -> np.ndarray | None:
    """What a user would write: red hues, the largest outline, its moments."""
    hsv = cv2.cvtColor(picture, cv2.COLOR_BGR2HSV)
    mask = cv2.inRange(hsv, (0, 90, 30), (12, 255, 255))
    mask |= cv2.inRange(hsv, (165, 90, 30), (180, 255, 255))
    outlines = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[-2]
    if not outlines:
        return None
    m = cv2.moments(max(outlines, key=cv2.contourArea))
    return np.array([m['m10'], m['m01']]) / m['m00'] if m['m00'] else None
