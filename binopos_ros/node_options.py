"""What each node takes, and what parameter files and words give it: one rule for all verbs."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from binopos_ros.arrivals import ArrivalOptions
from binopos_ros.bag.rig_topics import NAMESPACE
from binopos_ros.detection import DetectorOptions
from binopos_ros.parameter_files import Entry, RosArguments, read_blocks
from binopos_ros.parameters import (
    CONTROLS,
    QOS_OVERRIDES,
    ParameterError,
    ParameterSpec,
    build,
    checked,
    refuse_unknown,
    specs_of,
)
from binopos_ros.platform import FixedFrameOptions
from binopos_ros.smoothing.stage import SmootherOptions, filter_options_type
from binopos_ros.triangulation.options import TriangulatorOptions

#: What a bag is processed by, and what runs on a rig.
STAGES = ('detector', 'triangulator', 'smoother')
LIVE = ('camera', *STAGES)
NODES = (
    *LIVE,
    'player',
    'recorder',
    'viewer',
    'calibrator',
)
#: What ROS itself declares for every node, with its type.
OF_ROS: Mapping[str, type] = {'use_sim_time': bool, 'start_type_description_service': bool}
#: Parameters that name a file; where it lies beside the parameter file, its name is enough.
FILES = ('calibration_covariance', 'left.camera_info_url', 'right.camera_info_url')
#: Names this much alike are taken for a slip of the pen.
ALIKE = 0.75


class Parameters:
    """Parameter values by node, out of layers: files, then the words after `--ros-args`.

    Args:
        files: ROS 2 parameter files; later ones win.
        words: the words after `--ros-args`; those that are no parameters are in `others`.
        namespace: of the nodes, unless a word `-r __ns:=` says otherwise.

    Raises:
        ParameterError: a file or a word cannot be read, or a word names no node of the suite.
    """

    def __init__(
        self,
        files: Sequence[Path] = (),
        words: Sequence[str] = (),
        namespace: str = NAMESPACE,
    ) -> None:
        self._words = RosArguments.of(words)
        self._blocks = [block for path in files for block in read_blocks(path)]
        self._blocks += self._words.blocks
        self._namespace = namespace
        self.others = self._words.others
        self.sources = [*map(str, [*files, *self._words.files])]
        self.sources += [f'-p {word}' for word in self._words.assignments]
        self._refuse_strangers()

    def of_node(self, name: str) -> dict[str, Any]:
        """A node's values by parameter, without those that belong to ROS.

        Raises:
            ParameterError: a block that names the node holds a parameter that it has not, or a
            value has the wrong type or is out of range.
        """
        values = self.given(name)
        return {key: value for key, value in values.items() if not _is_of_ros(key)}

    def given(self, name: str) -> dict[str, Any]:
        """As `of_node`, and what ROS itself takes: `use_sim_time`, `qos_overrides.*`."""
        full_name = self._words.full_name(name, self._namespace)
        names = {name, full_name.rpartition('/')[2]}
        blocks = [block for block in self._blocks if block.matches(full_name)]
        method = [block.entries['method'] for block in blocks if 'method' in block.entries]
        specs = _specs(name, method[-1] if method else Entry(None, ''))
        values: dict[str, Any] = {}
        for block in blocks:
            for key, entry in block.entries.items():
                if key in specs:
                    values[key] = _at(entry, checked_or_none, specs[key], _located(key, entry))
                elif _is_of_ros(key) or (name == 'camera' and CONTROLS in key):
                    values[key] = _of_ros(key, entry)
                elif block.node in names:
                    _at(entry, refuse_unknown, [key], specs)
        return values | self._derived(name, values)

    def check(self, name: str) -> None:
        """See that a node could start with its values, as far as can be told without it.

        Raises:
            ParameterError: as `of_node`.
            The room's own error: the values do not fit together.
        """
        values = {key: value for key, value in self.of_node(name).items() if CONTROLS not in key}
        for options_type in options_types(name, values.get('method')):
            own = specs_of(options_type)
            build(options_type, {key: value for key, value in values.items() if key in own})

    def _derived(self, name: str, values: dict[str, Any]) -> dict[str, Any]:
        """What follows for a node from what the triangulator was told, where it is not given."""
        if name == 'detector' and 'mirror_above' not in values:
            # Who looks through the surface itself does not see things mirrored in it.
            return {'mirror_above': False} if _through_surface(self.given('triangulator')) else {}
        if name == 'smoother' and not values.get('target_diameter'):
            diameter = self.given('triangulator').get('target.diameter')
            return {'target_diameter': diameter} if diameter else {}
        return {}

    def notices(self) -> list[str]:
        """Blocks that hold for nothing and look as if they were meant for a node of the suite."""
        told = []
        for block in self._blocks:
            known = block.node in NODES or block.node in self._renamed()
            if known and block.key.count('/') == 1 and not self._namespace_is_root():
                told.append(
                    f'{block.place}: {block.key} is a node without a namespace, and holds for '
                    f'none: write /**/{block.node}'
                )
            elif not known and not block.is_wild and (near := _near(block.node)):
                told.append(
                    f'{block.place}: {block.key} names no node of the suite and holds for none: '
                    f'did you mean {near!r}?'
                )
        return told

    def _namespace_is_root(self) -> bool:
        return self._words.full_name('', self._namespace).strip('/') == ''

    def _renamed(self) -> set[str]:
        names = (self._words.full_name(name, self._namespace) for name in NODES)
        return {name.rpartition('/')[2] for name in names}

    def _refuse_strangers(self) -> None:
        """What is typed for a node or a parameter that the suite has not is a slip of the pen."""
        for block in self._blocks:
            if not block.typed:
                continue
            if block.is_wild:
                every = [key for name in NODES for key in _every_spec(name)]
                for key, entry in block.entries.items():
                    if not _is_of_ros(key) and CONTROLS not in key:
                        _at(entry, refuse_unknown, [key], every)
            elif block.node not in NODES and block.node not in self._renamed():
                near = _near(block.node)
                hint = f'did you mean {near!r}?' if near else f'its nodes: {", ".join(NODES)}'
                msg = f'{block.place}: the suite has no node {block.node!r}: {hint}'
                raise ParameterError(msg)


def checked_or_none(spec: ParameterSpec, value: Any) -> Any:
    """The value as the parameter's own type; None, which keeps the default, stays None.

    Raises:
        ParameterError: wrong type, not finite, out of range or not among the choices.
    """
    return None if value is None else checked(spec, value)


def _located(key: str, entry: Entry) -> Any:
    """The value; a file that lies beside the parameter file with its whole path."""
    if key not in FILES or entry.folder is None or not isinstance(entry.value, str):
        return entry.value
    beside = entry.folder / entry.value
    return str(beside.absolute()) if entry.value and beside.is_file() else entry.value


def _through_surface(triangulator: Mapping[str, Any]) -> bool:
    """Whether the cameras look from the air through the water's surface, with nothing between."""
    indices: Sequence[float] = triangulator.get('interface.indices') or ()
    in_housing = triangulator.get('left_port.indices') or triangulator.get('right_port.indices')
    return len(indices) == 2 and indices[0] < indices[1] and not in_housing


def options_types(name: str, method: str | None = None) -> list[type]:
    """The options that a node declares; the smoother's are its own, the robot's, its filter's."""
    match name:
        case 'detector':
            return [DetectorOptions, ArrivalOptions]
        case 'triangulator':
            return [TriangulatorOptions]
        case 'smoother':
            chosen = method or SmootherOptions().method
            return [SmootherOptions, FixedFrameOptions, filter_options_type(chosen)]
        # Offline verbs do without these, and need not wait for their import.
        case 'camera':
            from binopos_ros.capture.options import CaptureOptions

            return [CaptureOptions]
        case 'player':
            from binopos_ros.bag.playback import PlayerOptions

            return [PlayerOptions]
        case 'recorder':
            from binopos_ros.bag.recording import RecorderOptions

            return [RecorderOptions]
        case 'viewer':
            from binopos_ros.view.options import ViewerOptions

            return [ViewerOptions]
    return []


def _specs(name: str, method: Entry) -> dict[str, ParameterSpec]:
    """What a node declares, with that value of the parameter `method`."""
    if name == 'smoother':
        _at(method, checked_or_none, specs_of(SmootherOptions)['method'], method.value)
    types = options_types(name, method.value)
    return {key: spec for each in types for key, spec in specs_of(each).items()}


def _every_spec(name: str) -> set[str]:
    """What a node declares with whatever method."""
    methods = specs_of(SmootherOptions)['method'].choices if name == 'smoother' else ('',)
    return {key for method in methods for key in _specs(name, Entry(method, ''))}


def _of_ros(key: str, entry: Entry) -> Any:
    kind = OF_ROS.get(key)
    if kind is not None and not isinstance(entry.value, kind):
        msg = f'{entry.place}: parameter {key!r} is {entry.value!r}: give true or false'
        raise ParameterError(msg)
    return entry.value


def _is_of_ros(key: str) -> bool:
    return key in OF_ROS or key.startswith(QOS_OVERRIDES)


def _near(node: str) -> str:
    near = difflib.get_close_matches(node, NODES, n=1, cutoff=ALIKE)
    return near[0] if near else ''


def _at(entry: Entry, check: Any, *arguments: Any) -> Any:
    """What a check returns; its refusal says where the value was given."""
    try:
        return check(*arguments)
    except ParameterError as error:
        msg = f'{entry.place}: {error}'
        raise ParameterError(msg) from None
