"""The documents point at what exists: files, scripts, verbs and topics."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from binopos_ros.cli import VERBS

PROJECT = Path(__file__).resolve().parent.parent
DOCUMENTS = sorted([PROJECT / 'README.md', *PROJECT.glob('docs/*.md'), *PROJECT.glob('bags/*.md')])


@pytest.mark.parametrize('path', DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_to_files(path):
    for target in re.findall(r'\]\(([^)#]+)(?:#[^)]*)?\)', path.read_text()):
        if '://' not in target:
            assert (path.parent / target).exists(), target


@pytest.mark.parametrize('path', DOCUMENTS, ids=lambda path: path.name)
def test_scripts_and_verbs_that_are_named_exist(path):
    text = path.read_text()
    for script in re.findall(r'python ((?:bench|docs/figures)/[\w/]+\.py)', text):
        assert (PROJECT / script).is_file(), script
    # In code only: prose may speak of what binopos is.
    for verb in re.findall(r'(?:^|`)binopos ([a-z]+)', text, re.MULTILINE):
        assert verb in VERBS, verb


def test_the_readme_names_every_topic_and_verb():
    text = (PROJECT / 'README.md').read_text()
    for verb in VERBS:
        assert f'binopos {verb}' in text
    for topic in ('target/pose', 'target/position', 'target/odometry', 'left/centroid'):
        assert f'`{topic}`' in text


def test_no_document_names_a_place_on_somebodys_machine():
    for path in DOCUMENTS:
        assert not re.search(r'(?<![\w.])/(?:root|work|home/\w+)/', path.read_text()), path
