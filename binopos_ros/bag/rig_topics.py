"""Which topics of a bag are the rig's, whatever the bag calls them.

The names of the contract (`left/image_raw/compressed`, `left/camera_info`, ... in any namespace)
come first. Else two image topics whose names differ only in a word for the side are the rig, where
there is one such pair. What an image topic is, its type decides and not its name.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from binopos_ros.bag.errors import BagError
from binopos_ros.bag.messages import (
    CAMERA_INFO,
    COMPRESSED_IMAGE,
    IMAGE,
    ODOMETRY,
    POSE,
    POSE_WITH_COVARIANCE,
)
from binopos_ros.bag.playback import absolute, renaming
from binopos_ros.bag.reader import BagReader
from binopos_ros.bag.records import TopicInfo
from binopos_ros.sides import SIDES

#: Of a side-by-side topic: each picture shows both cameras' views.
BOTH = 'both'
#: Where the rig's own topics are put when the bag's names tell no namespace.
NAMESPACE = '/stereo'
SUFFIXES = {'compressed': 'image_raw/compressed', 'raw': 'image_raw', 'camera_info': 'camera_info'}
TRUTH = 'truth/pose'
#: The truth in the frame in which the robot moves, and how it moves.
FIXED_TRUTH = 'truth/fixed_pose'
PLATFORM_ODOMETRY = 'platform/odometry'
#: Names, by kind, of what is of no camera.
OF_NO_CAMERA = {'truth': TRUTH, 'fixed truth': FIXED_TRUTH, 'odometry': PLATFORM_ODOMETRY}
TF_NAMES = {'transforms': '/tf', 'static transforms': '/tf_static'}
KINDS = {COMPRESSED_IMAGE: 'compressed', IMAGE: 'raw'}
POSES = (POSE_WITH_COVARIANCE, POSE, ODOMETRY)

_SIDE = re.compile(r'(?<![a-z])(left|right|infra[12]|[lr])(?![a-z0-9])')
_SIDE_OF = {'left': 'left', 'l': 'left', 'infra1': 'left'}
#: Words in the names of images that are no pictures of the scene.
_NO_PICTURES = {'depth', 'compressedDepth', 'disparity', 'confidence', 'overlay', 'theora'}
_RECTIFIED = {'rect', 'rectified'}
_GREY = {'mono', 'gray', 'grey'}


@dataclass(frozen=True)
class TopicChoice:
    """What the user says of a bag's names; '' and () where nothing is said."""

    left: str = ''  #: topic of the left camera's images
    right: str = ''  #: topic of the right camera's images
    side_by_side: str = ''  #: topic of images that show the left view and, beside it, the right
    namespace: str = ''  #: of the rig, where the bag holds several
    remap: tuple[str, ...] = ()  #: FROM:=TO, names to read the bag's topics under

    def __post_init__(self) -> None:
        if bool(self.left) != bool(self.right):
            given, other = ('left', 'right') if self.left else ('right', 'left')
            message = f'--{given} is given without --{other}: give both image topics'
            raise BagError(message)
        if self.left and self.side_by_side:
            message = '--side-by-side excludes --left and --right: give one or the other'
            raise BagError(message)
        if self.left and absolute(self.left) == absolute(self.right):
            message = f'--left and --right are both {self.left}: two topics, or --side-by-side'
            raise BagError(message)


class Role(NamedTuple):
    """What a topic is to the rig."""

    kind: str  #: 'compressed', 'raw', 'camera_info', or one of OF_NO_CAMERA and TF_NAMES
    side: str  #: 'left', 'right', BOTH, or '' for what is of no camera

    @property
    def is_image(self) -> bool:
        """Whether the topic holds pictures."""
        return self.kind in KINDS.values()


@dataclass(frozen=True)
class RigTopics:
    """The rig's topics in a bag.

    Attributes:
        namespace: of the rig's own topics, with its leading slash; '' for the root.
        roles: by the topics' names in the bag.
        rectified: whether the pictures are rectified: then P, not K and D, is their camera.
        notes: what a user should know of the choice, a line each.
    """

    namespace: str
    roles: dict[str, Role]
    rectified: bool = False
    notes: tuple[str, ...] = ()

    def name_of(self, topic: str) -> str:
        """The contract's name for a topic of the rig."""
        role = self.roles[topic]
        if role.kind in TF_NAMES:
            return TF_NAMES[role.kind]
        if role.kind in OF_NO_CAMERA:
            return f'{self.namespace}/{OF_NO_CAMERA[role.kind]}'
        return f'{self.namespace}/{role.side}/{SUFFIXES[role.kind]}'

    def of(self, kind: str, side: str) -> list[str]:
        """Topics of a kind and side: `kind` 'camera_info', or 'image' for either kind of image."""
        return [
            topic
            for topic, role in self.roles.items()
            if role.side in (side, BOTH if kind == 'image' else side)
            and (role.is_image if kind == 'image' else role.kind == kind)
        ]

    @classmethod
    def find(
        cls,
        reader: BagReader,
        choice: TopicChoice | None = None,
        *,
        calibrated: bool = False,
    ) -> RigTopics:
        """Find the rig's images and calibrations.

        `calibrated`: the bag's camera_info is not wanted, as the calibration is known otherwise.

        Raises:
            BagError: nothing fits, more than one thing fits, or a topic given is not there.
        """
        return _Search(reader, choice or TopicChoice(), calibrated).run()


@dataclass
class _Stream:
    """The pictures of one camera: the same ones raw, compressed, or both."""

    topics: dict[str, str] = field(default_factory=dict)  # kind -> topic

    def best(self, counts: Mapping[str, int]) -> str:
        """The topic that lost least: the most messages, and raw ones if equally many."""
        kinds = sorted(self.topics, key=lambda kind: (counts[self.topics[kind]], kind == 'raw'))
        return self.topics[kinds[-1]]


class _Search:
    """`names` are those under which the bag's topics are read, by which all is looked up."""

    def __init__(self, reader: BagReader, choice: TopicChoice, calibrated: bool) -> None:
        rename = renaming(choice.remap)
        self.path = reader.path
        self.choice = choice
        self.calibrated = calibrated
        self.in_bag = {rename(topic): topic for topic in reader.topics}
        self.topics: dict[str, TopicInfo] = {
            name: reader.topics[topic] for name, topic in self.in_bag.items()
        }
        self.images = {
            name: KINDS[info.type]
            for name, info in self.topics.items()
            if info.type in KINDS and info.count
        }
        self.infos = [
            name for name, info in self.topics.items() if info.type == CAMERA_INFO and info.count
        ]
        self.given_namespace = absolute(choice.namespace).rstrip('/') if choice.namespace else ''

    def run(self) -> RigTopics:
        if self.choice.side_by_side:
            image = self._given(self.choice.side_by_side, 'side-by-side')
            return self._made(self._namespace(), {BOTH: image})
        if self.choice.left:
            images = {side: self._given(getattr(self.choice, side), side) for side in SIDES}
            return self._made(self._namespace(), images)
        return self._found()

    def _namespace(self) -> str:
        return self.given_namespace or NAMESPACE

    def _given(self, topic: str, option: str) -> str:
        """A topic that the user names, by its name in the bag or by the one it is read under."""
        by_old_name = {absolute(old): new for new, old in self.in_bag.items()}
        name = absolute(topic)
        name = name if name in self.topics else by_old_name.get(name, name)
        if name not in self.topics:
            message = f'{self.path}: --{option}: no topic {topic} in this bag; {self._listing()}'
            raise BagError(message)
        if name not in self.images:
            info = self.topics[name]
            what = f'holds {info.type}, no images' if info.count else 'holds no message'
            message = f'{self.path}: --{option}: {topic} {what}; {self._listing()}'
            raise BagError(message)
        return name

    def _found(self) -> RigTopics:
        pairs = self._pairs()
        ranks = {key: _rank(key) for key, sides in pairs.items() if len(sides) == len(SIDES)}
        keys = [key for key, rank in ranks.items() if rank == min(ranks.values())]
        if len(keys) == 1:
            (key,) = keys
            counts = {name: info.count for name, info in self.topics.items()}
            images = {side: pairs[key][side].best(counts) for side in SIDES}
            own = _contract_namespace(key)
            return self._made(self._namespace() if own is None else own, images)
        if keys:
            raise BagError(self._several(keys))
        self._refuse_half_a_rig(pairs)
        untold = 'no two image topics differ in a word for the side alone; ' if self.images else ''
        space = self.given_namespace
        if space and not any(name.startswith(f'{space}/') for name in self.images):
            untold = f'--namespace {space}: no image topic lies below it; '
        message = f'{self.path}: {untold}{self._listing()}'
        raise BagError(message)

    def _pairs(self) -> dict[str, dict[str, _Stream]]:
        """By name with the side left out, the pictures of each side."""
        pairs: dict[str, dict[str, _Stream]] = {}
        for name, kind in self.images.items():
            stem = _stem(name, kind)
            sides = {_SIDE_OF.get(word, 'right') for word in _SIDE.findall(stem)}
            below = not self.given_namespace or name.startswith(f'{self.given_namespace}/')
            if len(sides) == 1 and below and not _words(name) & _NO_PICTURES:
                streams = pairs.setdefault(_SIDE.sub('*', stem), {})
                streams.setdefault(sides.pop(), _Stream()).topics[kind] = name
        return pairs

    def _several(self, keys: list[str]) -> str:
        spaces = sorted({key.split('/*', 1)[0] or '/' for key in keys})
        if len(spaces) == len(keys):
            return (
                f'{self.path}: holds more than one rig: {", ".join(spaces)}: choose one with '
                f'--namespace {spaces[0]}'
            )
        return f'{self.path}: holds more than one pair of image topics; {self._listing()}'

    def _refuse_half_a_rig(self, pairs: dict[str, dict[str, _Stream]]) -> None:
        for key, sides in pairs.items():
            namespace = _contract_namespace(key)
            if namespace is not None:
                (there,) = sides
                missing = SIDES[1 - SIDES.index(there)]
                message = (
                    f'{self.path}: {namespace}/{missing}/image_raw/compressed or image_raw is '
                    f'missing or empty{self._misused(namespace, missing)}: record it beside '
                    f'{namespace}/{there}; {self._listing()}'
                )
                raise BagError(message)

    def _misused(self, namespace: str, side: str) -> str:
        for suffix in SUFFIXES.values():
            info = self.topics.get(f'{namespace}/{side}/{suffix}')
            if info is not None and info.count:
                return f' ({suffix} holds {info.type})'
        return ''

    def _made(self, namespace: str, images: dict[str, str]) -> RigTopics:
        rectified = any(_words(name) & _RECTIFIED for name in images.values())
        roles = {self.in_bag[name]: Role(self.images[name], side) for side, name in images.items()}
        for side in () if self.calibrated else SIDES:
            info = self._camera_info(side, images.get(side))
            if info is None:
                raise BagError(self._without_camera_info(namespace, side))
            roles[self.in_bag[info]] = Role('camera_info', side)
        notes = []
        if _contract_of(images) is None:
            notes.append('pictures: ' + ', '.join(f'{side} {images[side]}' for side in images))
        if rectified:
            notes.append(
                'pictures are rectified: their cameras are P of camera_info, without distortion, '
                "and the rig's frame is that of the rectified left picture"
            )
        for kind in ('truth', 'fixed truth'):
            truth = f'{namespace}/{OF_NO_CAMERA[kind]}'
            if truth not in self.topics:
                continue
            if self.topics[truth].type in POSES:
                roles[self.in_bag[truth]] = Role(kind, '')
            else:
                notes.append(f'{truth} holds {self.topics[truth].type}, no poses: left out')
        return RigTopics(namespace, roles, rectified, tuple(notes))

    def _camera_info(self, side: str, image: str | None) -> str | None:
        """The calibration that belongs to a camera's images; None where there is none."""
        if image is not None:
            folder = _stem(image, self.images[image])
            while '/' in folder:
                folder = folder.rsplit('/', 1)[0]
                here = [name for name in self.infos if name.rsplit('/', 1)[0] == folder]
                if here:
                    return _fitting(here, rectified=bool(_words(image) & _RECTIFIED))
                if not _SIDE.search(folder):
                    break
        below = f'{self.given_namespace}/' if self.given_namespace else ''
        named = [
            name
            for name in self.infos
            if {_SIDE_OF.get(word, 'right') for word in _SIDE.findall(name)} == {side}
            and name.startswith(below)
        ]
        return named[0] if len(named) == 1 else None

    def _without_camera_info(self, namespace: str, side: str) -> str:
        own = f'{namespace}/{side}/camera_info'
        there = ', '.join(self.infos) or 'none'
        return (
            f'{self.path}: {own} is missing or empty{self._not_camera_info(own)}; CameraInfo '
            f'topics in this bag: {there}: record it beside the images, or give --calibration DIR'
        )

    def _not_camera_info(self, name: str) -> str:
        info = self.topics.get(name)
        if info is None or info.type == CAMERA_INFO or not info.count:
            return ''
        return f' (it holds {info.type})'

    def _listing(self) -> str:
        """The image topics of the bag, and the line to type."""
        if not self.images:
            return 'it holds no image topic: record the images of both cameras'
        there = ', '.join(f'{name} ({self.topics[name].count})' for name in sorted(self.images))
        first, second = [*sorted(self.images), 'TOPIC'][:2]
        line = (
            f'--side-by-side {first}'
            if len(self.images) == 1
            else f'--left {first} --right {second}'
        )
        return f'its image topics: {there}: name them, as in {line}'


def _stem(name: str, kind: str) -> str:
    """The name without the transport's own ending."""
    return name.removesuffix('/compressed') if kind == 'compressed' else name


def _words(name: str) -> set[str]:
    return set(re.split(r'[/_]', name))


def _contract_namespace(key: str) -> str | None:
    namespace, found, rest = key.partition('/*/image_raw')
    return namespace if found and not rest and '*' not in namespace else None


def _contract_of(images: Mapping[str, str]) -> str | None:
    """The namespace of images that bear the contract's names, None where they do not."""
    keys = {
        name.removesuffix('/compressed').replace(f'/{side}/', '/*/')
        for side, name in images.items()
    }
    return _contract_namespace(keys.pop()) if len(keys) == 1 else None


def _rank(key: str) -> tuple[bool, bool, bool]:
    """The contract's names first, then coloured pictures, and those as the camera took them."""
    words = _words(key)
    return _contract_namespace(key) is None, bool(words & _GREY), bool(words & _RECTIFIED)


def _fitting(infos: Iterable[str], *, rectified: bool) -> str:
    """Of several calibrations beside an image, the one whose name says what the image's says."""
    return min(
        sorted(infos),
        key=lambda name: (
            bool(_words(name.rsplit('/', 1)[1]) & _RECTIFIED) != rectified,
            not name.endswith('/camera_info'),
        ),
    )
