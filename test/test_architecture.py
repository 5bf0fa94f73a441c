"""The plan of the house: which room may import which, and no circles of rooms or of files.

An import counts wherever it stands, in functions too. One under `if TYPE_CHECKING:` counts for the
table, since whoever reads the file has to know the other room, but makes no circle: it never runs.
"""

from __future__ import annotations

import ast
import graphlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import pytest

PACKAGE = 'binopos_ros'
ROOT = Path(__file__).parents[1] / PACKAGE

#: Modules below all rooms: words and files that every room may use.
BELOW = frozenset({'parameters', 'plain_yaml', 'reasons', 'sides', 'sheet', 'drawn'})
STAGES = frozenset({'optics', 'pairing', 'capture', 'detection', 'triangulation', 'platform'})
STAGES |= {'smoothing', 'calibration', 'simulation', 'bag'}

#: What each room, and each module beside the rooms, may import. A room that is not built yet may
#: stand here; one that is built must.
MAY_IMPORT: dict[str, frozenset[str]] = {
    'optics': frozenset(),
    'pairing': frozenset(),
    'arrivals': frozenset({'pairing'}),
    'capture': frozenset({'pairing'}),
    'detection': frozenset({'optics'}),
    'triangulation': frozenset({'optics', 'pairing'}),
    'platform': frozenset(),
    'smoothing': frozenset(),
    'calibration': frozenset({'optics', 'detection', 'pairing'}),
    'simulation': frozenset({'optics', 'platform'}),
    # Its messages hold calibrations, whose type is of the optics, and pairs.
    'bag': frozenset({'optics', 'pairing'}),
    # All stages behind one object, what a run tells, and what each node may be told.
    'tracker': STAGES - {'capture', 'detection', 'calibration', 'simulation', 'bag'},
    'pipeline': STAGES - {'capture', 'calibration', 'simulation', 'bag'} | {'arrivals', 'tracker'},
    'report': frozenset({'pipeline', 'pairing', 'smoothing'}),
    'parameter_files': frozenset(),
    'view': frozenset({'bag', 'detection'}),
    'node_options': STAGES | {'parameter_files', 'arrivals', 'view'},
    'evaluation': STAGES | {'tracker', 'pipeline', 'report'},
    'nodes': STAGES
    | {'arrivals', 'tracker', 'pipeline', 'report', 'parameter_files', 'node_options', 'view'},
}
MAY_IMPORT['cli'] = frozenset(MAY_IMPORT)
MAY_IMPORT['__main__'] = frozenset({'cli', 'nodes'})

#: Who alone may import what: packages that only one kind of machine has, or that belong to a room.
OWNERS = {
    'rclpy': {'nodes', 'cli'},
    'sensor_msgs': {'nodes', 'cli'},
    'geometry_msgs': {'nodes', 'cli'},
    'mcap': {'bag', 'cli'},
    'rosbags': {'bag', 'cli'},
    'usb': {'capture', 'cli'},
    'websockets': {'view'},
    'matplotlib': {'drawn', 'calibration', 'evaluation', 'cli'},
}


class Import(NamedTuple):
    """One import: from which file, of which module, and whether it ever runs."""

    file: Path
    module: str
    runs: bool

    def __str__(self) -> str:
        return f'{self.file.relative_to(ROOT.parent)} imports {self.module}'


def module_of(file: Path) -> str:
    parts = file.relative_to(ROOT.parent).with_suffix('').parts
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


FILES = {module_of(file): file for file in sorted(ROOT.rglob('*.py'))}


def room_of(module: str) -> str:
    """The room of a module, or the module's own name where it stands beside the rooms."""
    return module.split('.')[1] if '.' in module else ''


def imports_of(file: Path) -> Iterator[Import]:
    tree = ast.parse(file.read_text(encoding='utf-8'))
    never = {
        id(node)
        for branch in ast.walk(tree)
        if isinstance(branch, ast.If) and 'TYPE_CHECKING' in ast.dump(branch.test)
        for child in branch.body
        for node in ast.walk(child)
    }
    package = module_of(file).split('.')
    if file.name != '__init__.py':
        package = package[:-1]
    for node in ast.walk(tree):
        runs = id(node) not in never
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(file, alias.name, runs)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) + 1 - node.level] if node.level else []
            origin = '.'.join([*base, *([node.module] if node.module else [])])
            for alias in node.names:
                inner = f'{origin}.{alias.name}'
                yield Import(file, inner if inner in FILES else origin, runs)


IMPORTS = [one for file in FILES.values() for one in imports_of(file)]
#: Compiled modules import nothing of ours.
COMPILED = {module_of(file) for file in ROOT.rglob('*.c')}
OWN = [
    one for one in IMPORTS if one.module.split('.')[0] == PACKAGE and one.module not in COMPILED
]


def circle(graph: Mapping[str, set[str]]) -> list[str]:
    """Nodes of a circle in a graph, empty where there is none."""
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return list(error.args[1])
    return []


def test_every_room_is_in_the_table() -> None:
    rooms = {room_of(module) for module in FILES} - {''}
    assert rooms - BELOW <= MAY_IMPORT.keys()


@pytest.mark.parametrize('room', sorted(MAY_IMPORT.keys() | BELOW))
def test_a_room_imports_what_the_table_allows(room: str) -> None:
    allowed = BELOW | MAY_IMPORT.get(room, frozenset()) | {room, ''}
    wrong = [
        str(one)
        for one in OWN
        if room_of(module_of(one.file)) == room and room_of(one.module) not in allowed
    ]
    assert wrong == []


def test_the_table_itself_has_no_circle() -> None:
    table = {room: set(allowed) - {room} for room, allowed in MAY_IMPORT.items()}
    assert circle(table) == []


def test_there_is_no_circle_of_files() -> None:
    graph: dict[str, set[str]] = {module: set() for module in FILES}
    for one in OWN:
        if one.runs:
            graph[module_of(one.file)].add(one.module)
    assert circle(graph) == []


def test_there_is_no_circle_of_sub_rooms() -> None:
    graph: dict[str, set[str]] = {}
    for one in OWN:
        # Of a room's own files only those in sub-rooms: what stands above them may use all.
        sides = [FILES[module].parent for module in (module_of(one.file), one.module)]
        own, other = ('.'.join(side.relative_to(ROOT).parts) for side in sides)
        if one.runs and own != other and own.count('.') == other.count('.') == 1:
            graph.setdefault(own, set()).add(other)
    assert circle(graph) == []


def test_packages_are_imported_where_they_belong() -> None:
    wrong = [
        str(one)
        for one in IMPORTS
        for owners in [OWNERS.get(one.module.split('.')[0])]
        if owners is not None and room_of(module_of(one.file)) not in owners
    ]
    assert wrong == []


def test_circles_are_seen() -> None:
    assert circle({'a': {'b'}, 'b': {'c'}, 'c': {'a'}})
    assert circle({'a': {'b'}, 'b': set()}) == []
