"""The container's recipe, which cannot be built here, names what exists."""

from __future__ import annotations

import json
import re
from xml.etree import ElementTree

import binopos_ros
from binopos_ros.cli.parser import VerbParser
from binopos_ros.cli.run import add_arguments

#: Commands of the base image, and those that the packages installed in it bring.
COMMANDS = {'apt-get', 'python3', 'rm', 'useradd'}


def instructions(project):
    """(word, rest) of each instruction, continued lines joined, comments left out."""
    text = re.sub(r'^\s*#.*\n', '', (project / 'Dockerfile').read_text(), flags=re.MULTILINE)
    lines = re.sub(r'\\\n\s*', ' ', text).splitlines()
    return [tuple(line.split(maxsplit=1)) for line in lines if line.strip()]


def test_every_instruction_is_one(project):
    known = ['FROM', 'RUN', 'WORKDIR', 'COPY', 'USER', 'ENV', 'LABEL', 'ENTRYPOINT', 'CMD']
    assert {word for word, _ in instructions(project)} == set(known)


def test_what_is_copied_exists_and_is_all_that_setup_reads(project):
    copied = set()
    for word, rest in instructions(project):
        if word == 'COPY' and '--from' not in rest:
            *sources, _ = rest.split()
            copied.update(sources)
    assert all((project / each).exists() for each in copied), copied
    ignored = (project / '.dockerignore').read_text().split()
    assert not copied & set(ignored)
    setup = (project / 'setup.py').read_text()
    for read in ('README.md', 'config', 'bags', 'resource', 'package.xml'):
        assert read in setup
        assert read in copied


def test_every_command_is_of_the_image_and_leaves_the_user_no_root(project):
    users = []
    for word, rest in instructions(project):
        if word == 'RUN':
            assert {each.split()[0] for each in rest.split('&&')} <= COMMANDS, rest
            for each in rest.split('&&'):
                if 'apt-get install' in each:
                    assert '-y --no-install-recommends' in each
        if word == 'USER':
            users.append(rest)
    assert users == ['binopos']
    assert '--groups video binopos' in (project / 'Dockerfile').read_text()


def test_it_installs_what_the_package_depends_on(project):
    text = (project / 'Dockerfile').read_text()
    package = ElementTree.parse(project / 'package.xml').getroot()
    for depend in package.findall('exec_depend'):
        if depend.text.startswith('python3-'):
            assert depend.text in text, depend.text
    needed = re.search(r'install_requires=\[(.*?)\]', (project / 'setup.py').read_text(), re.S)[1]
    of_apt = {'numpy', 'opencv-python-headless', 'pyusb', 'PyYAML'}
    for name in re.findall(r"'([\w-]+)>=", needed):
        assert name in of_apt or re.search(rf'\b{name}\b', text), name


def test_it_runs_a_verb_and_says_what_it_may_do(project):
    found = dict(instructions(project)[::-1])
    assert json.loads(found['ENTRYPOINT'])[-1] == 'binopos'
    verb, *words = json.loads(found['CMD'])
    parser = VerbParser()
    add_arguments(parser)
    assert verb == 'run'
    assert str(parser.parse_args(words).config) == '/etc/binopos/rig.yaml'
    labels = dict(rest.split('=', 1) for word, rest in instructions(project) if word == 'LABEL')
    assert labels['version'] == f'"{binopos_ros.__version__}"'
    granted = json.loads(labels['permissions'].strip("'"))['HostConfig']
    assert granted['NetworkMode'] == 'host'
    assert not granted.get('Privileged')
    for label in ('tags', 'authors'):
        assert json.loads(labels[label].strip("'"))
