"""Every example runs as it stands and reaches what it is there to show."""

from __future__ import annotations

import json
import re
import runpy
import sys
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from binopos_ros.bag import BagReader
from binopos_ros.bag.messages import position_of

EXAMPLES = Path(__file__).resolve().parent.parent / 'examples'
PROGRAMS = sorted(EXAMPLES.glob('*.py'))
#: Needs nodes that publish; `test/nodes` hears it.
LIVE = 'subscribe_pose'


@pytest.fixture
def said(request, monkeypatch, capsys):
    """What an example prints."""
    path = EXAMPLES / f'{request.param}.py'
    monkeypatch.setattr(sys, 'argv', [str(path)])
    runpy.run_path(str(path), run_name='__main__')
    return capsys.readouterr().out


def numbers(text):
    return [float(each) for each in re.findall(r'-?\d+\.?\d*(?:e-?\d+)?', text)]


def of(name):
    return pytest.mark.parametrize('said', [name], indirect=True)


@of('triangulate_array')
def test_arrays_are_triangulated(said):
    bent, straight, noise = said.splitlines()
    assert numbers(bent)[0] < 1e-3
    assert numbers(straight)[0] > 20.0
    assert 'mm (x, y, z)' in noise


@of('smooth_csv')
def test_a_table_is_smoothed(said):
    count, raw, smooth = numbers(said)[:3]
    assert count == 90
    assert smooth < 0.6 * raw


@of('read_bag')
def test_a_bag_is_read(said):
    assert '  150  /stereo/left/image_raw/compressed  sensor_msgs/msg/CompressedImage' in said
    assert '640x480 px at 1700000000.000 s' in said


@pytest.fixture(scope='module')
def twelfth():
    """Where the demo bag's target truly is at its twelfth pair, m."""
    with BagReader(EXAMPLES.parent / 'bags' / 'demo') as bag:
        truth = bag.messages(topics=['/stereo/truth/pose'])
        return position_of(bag.decode(next(islice(truth, 11, None))))


@of('own_detector')
def test_another_detector_leads_to_the_same_place(said, twelfth):
    place = numbers(said.partition('raw')[2])[:3]
    np.testing.assert_allclose(place, twelfth, atol=0.002)


@of('process_bag')
def test_a_bag_is_processed_event_by_event(said, twelfth):
    assert said.startswith('12 poses')
    np.testing.assert_allclose(numbers(said.partition('at')[2])[:3], twelfth, atol=0.002)
    assert 'dropped: none' in said


@of('detect_target')
def test_a_target_is_found(said):
    assert re.search(r'centre \[.*\] px, diameter \d+', said)
    assert max(numbers(said.splitlines()[1])) < 0.2


@of('calibrate_interface')
def test_a_surface_is_found(said):
    true, found = (numbers(line)[:4] for line in said.splitlines())
    np.testing.assert_allclose(found[:3], true[:3], atol=2e-3)
    np.testing.assert_allclose(found[3], true[3], atol=5e-3)


@of('plot_uncertainty')
def test_a_longer_baseline_is_surer(said):
    near, far = zip(*(numbers(line)[1:] for line in said.splitlines()), strict=True)
    assert list(near) == sorted(near, reverse=True)
    assert all(a < b for a, b in zip(near, far, strict=True))


@of('compare_filters')
def test_filters_are_compared(said):
    rms = {line.split()[0]: float(line.split()[1]) for line in said.splitlines()}
    assert rms['cloud-kalman'] < 0.7 * rms['none']


def test_every_example_is_tested_and_listed():
    source = Path(__file__).read_text()
    listed = (EXAMPLES / 'README.md').read_text()
    for path in PROGRAMS:
        assert path.stem == LIVE or f"@of('{path.stem}')" in source
        assert f'[{path.name}]({path.name})' in listed


def test_the_notebook_still_prints_what_is_stored_in_it(capsys):
    notebook = json.loads((EXAMPLES / 'washbowl.ipynb').read_text())
    cells = [cell for cell in notebook['cells'] if cell['cell_type'] == 'code']
    names: dict[str, object] = {}
    for cell in cells:
        source = ''.join(cell['source'])
        if 'matplotlib' in source:
            matplotlib = pytest.importorskip('matplotlib')
            matplotlib.use('Agg')
        exec(source, names)
        stored = [''.join(each['text']) for each in cell['outputs'] if 'text' in each]
        assert numbers(capsys.readouterr().out) == pytest.approx(numbers(''.join(stored)), abs=0.1)
