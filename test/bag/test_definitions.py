"""Definitions of types that ROS 2 Jazzy itself does not have."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from binopos_ros.bag import BagError
from binopos_ros.bag.definitions import definition_of, full_name, installed_definition, store_for

DEPTH = """# How deep, and where from.
uint8 SONAR=1
uint8 source 1          # one of the above
std_msgs/Header header
Layer[<=4] layers
string<=8 name "sea"
float64[2] extent
"""
LAYER = 'float64 thickness\ngeometry_msgs/Point[] outline\n'


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An installed package with two message types, and what they need of the common ones."""
    texts = {
        'my_msgs/Depth': DEPTH,
        'my_msgs/Layer': LAYER,
        'std_msgs/Header': 'builtin_interfaces/Time stamp\nstring frame_id\n',
        'builtin_interfaces/Time': 'int32 sec\nuint32 nanosec\n',
        'geometry_msgs/Point': 'float64 x\nfloat64 y\nfloat64 z\n',
    }
    for name, text in texts.items():
        package, message = name.split('/')
        path = tmp_path / 'share' / package / 'msg' / f'{message}.msg'
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'/nowhere:{tmp_path}')
    return tmp_path


def test_an_installed_definition_brings_all_that_it_refers_to(workspace: Path) -> None:
    definition = installed_definition('my_msgs/msg/Depth', 'RIHS01_x')
    assert definition.type_hash == 'RIHS01_x'
    store = store_for('my_msgs/msg/Depth', definition)
    types = store.types
    message = types['my_msgs/msg/Depth'](
        source=1,
        header=types['std_msgs/msg/Header'](
            stamp=types['builtin_interfaces/msg/Time'](sec=1, nanosec=2), frame_id='rig'
        ),
        layers=[
            types['my_msgs/msg/Layer'](
                thickness=0.5, outline=[types['geometry_msgs/msg/Point'](x=1.0, y=2.0, z=3.0)]
            )
        ],
        name='sea',
        extent=np.array([4.0, 5.0]),
    )
    data = store.serialize_cdr(message, 'my_msgs/msg/Depth')
    back = store.deserialize_cdr(data, 'my_msgs/msg/Depth')
    assert back.layers[0].outline[0].z == 3.0
    assert back.header.frame_id == 'rig'
    assert back.extent.tolist() == [4.0, 5.0]


def test_a_definition_that_is_not_installed_is_named(workspace: Path) -> None:
    (workspace / 'share' / 'my_msgs' / 'msg' / 'Layer.msg').unlink()
    with pytest.raises(BagError, match="no definition of 'my_msgs/msg/Layer' is installed"):
        installed_definition('my_msgs/msg/Depth')


@pytest.mark.parametrize(
    ('name', 'full'),
    [('a/B', 'a/msg/B'), ('a/msg/B', 'a/msg/B'), ('a/srv/B_Event', 'a/srv/B_Event'), ('', '')],
)
def test_short_names_become_full_ones(name: str, full: str) -> None:
    assert full_name(name) == full


@pytest.mark.parametrize('text', ['float64 depth\n---\nfloat64 height', '%%%'])
def test_definitions_that_make_no_sense_are_refused_in_one_line(text: str) -> None:
    definition = definition_of('std_msgs/msg/String')._replace(text=text)
    with pytest.raises(BagError, match="'my_msgs/msg/Odd' cannot be parsed") as refusal:
        store_for('my_msgs/msg/Odd', definition)
    assert '\n' not in str(refusal.value)
