"""Which topics of a bag are the rig's: the names of the contract under any namespace."""

from __future__ import annotations

from dataclasses import dataclass

from binopos_ros.bag import BagError, BagReader
from binopos_ros.sides import SIDES

SUFFIXES = {'compressed': 'image_raw/compressed', 'raw': 'image_raw', 'camera_info': 'camera_info'}
TRUTH = 'truth/pose'


@dataclass(frozen=True)
class StereoTopics:
    """Topics of the rig in a bag: (role, side) by full name."""

    namespace: str
    roles: dict[str, tuple[str, str]]

    @classmethod
    def find(cls, reader: BagReader, calibrated: bool = False) -> StereoTopics:
        """Find the rig's images and calibrations; without the latter where it is `calibrated`.

        Raises:
            BagError: a camera's images or its camera_info are missing, or there are two rigs.
        """
        found: dict[str, dict[str, tuple[str, str]]] = {}
        for topic, info in reader.topics.items():
            for side in SIDES:
                for role, suffix in SUFFIXES.items():
                    tail = f'/{side}/{suffix}'
                    if topic.endswith(tail) and info.count:
                        found.setdefault(topic[: -len(tail)], {})[topic] = (role, side)
        rigs = [name for name in found if _sides(found[name], image=True)]
        if not rigs:
            msg = (
                f'{reader.path}: holds no stereo images; '
                'needed: left/image_raw/compressed (or left/image_raw) and the same of right'
            )
            raise BagError(msg)
        if len(rigs) > 1:
            msg = f'{reader.path}: holds more than one rig: {", ".join(sorted(rigs))}'
            raise BagError(msg)
        namespace = rigs[0]
        roles = found[namespace]
        if calibrated:
            roles = {name: role for name, role in roles.items() if role[0] != 'camera_info'}
        for image in (True,) if calibrated else (True, False):
            missing = [side for side in SIDES if side not in _sides(roles, image)]
            if missing:
                what = 'image_raw/compressed or image_raw' if image else 'camera_info'
                msg = (
                    f'{reader.path}: {namespace}/{missing[0]}/{what} is missing or empty: '
                    f'record it beside {namespace}/{SIDES[1 - SIDES.index(missing[0])]}'
                )
                raise BagError(msg)
        truth = f'{namespace}/{TRUTH}'
        if truth in reader.topics:
            roles = roles | {truth: ('truth', '')}
        return cls(namespace, roles)


def _sides(roles: dict[str, tuple[str, str]], image: bool) -> set[str]:
    return {side for role, side in roles.values() if (role != 'camera_info') == image}
