"""The package builds with colcon and installs with pip, and what it installs runs."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import pytest

import binopos_ros

NODES = ('camera', 'detector', 'triangulator', 'smoother', 'player', 'recorder', 'viewer')


@pytest.fixture(scope='module')
def source(tmp_path_factory: pytest.TempPathFactory, project: Path) -> Path:
    """A copy of the files that make the package."""
    copy = tmp_path_factory.mktemp('source') / 'src' / 'binopos_ros'
    copy.mkdir(parents=True)
    for name in ('setup.py', 'setup.cfg', 'pyproject.toml', 'package.xml', 'README.md'):
        shutil.copy(project / name, copy)
    for name in ('binopos_ros', 'config', 'resource', 'bags'):
        shutil.copytree(project / name, copy / name, ignore=shutil.ignore_patterns('__pycache__'))
    return copy


@pytest.fixture(scope='module')
def install(source: Path) -> Path:
    """The install tree that `colcon build` makes."""
    pytest.importorskip('colcon_core', reason='colcon is not installed')
    workspace = source.parent.parent
    colcon = Path(sys.executable).with_name('colcon')
    environment = {**os.environ, 'PATH': f'{colcon.parent}{os.pathsep}{os.environ["PATH"]}'}
    done = subprocess.run(
        [str(colcon), 'build', '--event-handlers', 'console_direct+'],
        cwd=workspace,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return workspace / 'install'


def test_colcon_puts_every_executable_where_ros2_run_looks(install):
    folder = install / 'binopos_ros' / 'lib' / 'binopos_ros'
    assert {each.name for each in folder.iterdir()} >= {*NODES, 'binopos'}
    share = install / 'binopos_ros' / 'share'
    assert (share / 'ament_index/resource_index/packages/binopos_ros').is_file()
    assert (share / 'binopos_ros' / 'package.xml').is_file()
    assert (share / 'binopos_ros' / 'config' / 'binopos.yaml').is_file()


@pytest.mark.live
def test_a_node_runs_out_of_the_install_tree(install, ros_domain, tmp_path):
    executable = install / 'binopos_ros' / 'lib' / 'binopos_ros' / 'smoother'
    node = subprocess.Popen(
        ['sh', '-c', f'. {install}/setup.sh && cd {tmp_path} && exec {executable}'],
        stderr=subprocess.PIPE,
        text=True,
    )
    time.sleep(3.0)
    assert node.poll() is None, node.stderr.read()
    node.send_signal(signal.SIGINT)
    _, errors = node.communicate(timeout=10)
    assert (node.returncode, errors) == (0, '')


def test_pip_installs_a_binopos_that_runs(source, tmp_path):
    prefix = tmp_path / 'prefix'
    subprocess.run(
        [
            *(sys.executable, '-m', 'pip', 'install', '--quiet', '--no-deps'),
            *('--no-build-isolation', '--prefix', str(prefix), '--ignore-installed', str(source)),
        ],
        check=True,
        capture_output=True,
    )
    (packages,) = prefix.glob('lib/python*/site-packages')
    done = subprocess.run(
        [str(prefix / 'bin' / 'binopos'), '--version'],
        env={**os.environ, 'PYTHONPATH': str(packages)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ['binopos_ros', binopos_ros.__version__]
    share = prefix / 'share' / 'binopos_ros'
    assert (share / 'config' / 'fastdds.xml').is_file()
    assert (share / 'bags' / 'demo' / 'metadata.yaml').is_file()
    # Nodes are found by `ros2 run`, and lie on nobody's PATH.
    assert {each.name for each in (prefix / 'bin').iterdir()} == {'binopos'}
    nodes = {each.name: each for each in (prefix / 'lib' / 'binopos_ros').iterdir()}
    assert set(nodes) == set(NODES)
    assert all(os.access(each, os.X_OK) for each in nodes.values())
    for words, said in (
        (('doctor', '--print', 'systemd'), 'ExecStart='),
        (('doctor', '--print', 'udev'), 'GROUP="video"'),
        (('process', share / 'bags' / 'demo'), '-o/--output'),
    ):
        done = subprocess.run(
            [str(prefix / 'bin' / 'binopos'), *map(str, words)],
            env={**os.environ, 'PYTHONPATH': str(packages)},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert said in done.stdout + done.stderr
    assert (packages / 'binopos_ros' / 'view' / 'page' / 'index.html').is_file()


def test_the_versions_agree(project):
    package = ElementTree.parse(project / 'package.xml').getroot()
    assert package.get('format') == '3'
    assert package.findtext('version') == binopos_ros.__version__
    assert f"version='{binopos_ros.__version__}'" in (project / 'setup.py').read_text()


def test_every_verb_of_the_help_has_its_module(project):
    from binopos_ros.cli import VERBS

    for verb in VERBS:
        done = subprocess.run(
            [sys.executable, '-m', 'binopos_ros', verb, '--help'],
            cwd=project,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith(f'usage: binopos {verb} ')
