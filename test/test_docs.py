"""The documents point at what exists: files, scripts, verbs and topics."""

from __future__ import annotations

import importlib
import re
import shlex
from pathlib import Path

import pytest

from binopos_ros.cli import VERBS
from binopos_ros.cli.parser import VerbParser, split_ros_arguments
from binopos_ros.node_options import NODES, options_types
from binopos_ros.parameters import specs_of

PROJECT = Path(__file__).resolve().parent.parent
FOLDERS = '.', 'docs', 'bags', 'examples'
DOCUMENTS = sorted(path for folder in FOLDERS for path in PROJECT.glob(f'{folder}/*.md'))


#: Words that stand for what the reader puts there.
SHORTENED = {'N': '2', 'SECONDS': '2.0'}


def commands(path):
    """The verbs' command lines in a document's code blocks, continued lines joined."""
    text = re.sub(r'\\\n\s*', ' ', path.read_text())
    blocks = re.findall(r'^```(?:sh|bash|console)?\n(.*?)^```', text, re.MULTILINE | re.DOTALL)
    blocks += re.findall(r'^((?:    .*\n)+)', text, re.MULTILINE)
    lines = [line.strip().removeprefix('$ ') for block in blocks for line in block.splitlines()]
    return [line for line in lines if re.match(r'binopos [a-z]+ ', line)]


@pytest.fixture(scope='module')
def parsers():
    """Each verb's parser."""
    found = {}
    for verb in VERBS:
        found[verb] = VerbParser(prog=f'binopos {verb}')
        importlib.import_module(f'binopos_ros.cli.{verb}').add_arguments(found[verb])
    return found


def refused(parser, words, capsys):
    """What a parser says against words, '' where it takes them."""
    try:
        parser.parse_args([SHORTENED.get(word, word) for word in words])
    except SystemExit as leaving:
        return capsys.readouterr().err if leaving.code else ''
    return ''


@pytest.mark.parametrize('path', DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_to_files(path):
    for target, anchor in re.findall(r'\]\(([^)#]*)(?:#([^)]*))?\)', path.read_text()):
        # The site's reference is made when the site is.
        if '://' in target or target.startswith('reference/'):
            continue
        leads = path.parent / target if target else path
        assert leads.exists(), target
        if anchor:
            assert anchor in anchors(leads.read_text()), f'{target}#{anchor}'


def anchors(text: str) -> set[str]:
    """The anchors of a document's headings, as GitHub and the site make them."""
    headings = re.findall(r'^#+ +(.+)$', text, re.MULTILINE)
    words = [
        re.sub(r'[^\w\- ]', '', re.sub(r'\]\([^)]*\)', '', each)).strip() for each in headings
    ]
    return {each.lower().replace(' ', '-') for each in words}


@pytest.mark.parametrize('path', DOCUMENTS, ids=lambda path: path.name)
def test_scripts_and_verbs_that_are_named_exist(path):
    text = path.read_text()
    for script in re.findall(r'python ((?:bench|docs/figures)/[\w/]+\.py)', text):
        assert (PROJECT / script).is_file(), script
    # In code only: prose may speak of what binopos is.
    for verb in re.findall(r'(?:^|`)binopos ([a-z]+)', text, re.MULTILINE):
        assert verb in VERBS, verb


@pytest.mark.parametrize(
    'path', [each for each in DOCUMENTS if commands(each)], ids=lambda path: path.name
)
def test_every_command_is_taken_by_its_verb(path, parsers, capsys):
    """Its options exist and take what is given; what commands do is tested in their rooms."""
    for command in commands(path):
        verb, *words = shlex.split(command, comments=True)[1:]
        own, _ = split_ros_arguments(words)
        assert refused(parsers[verb], own, capsys) == '', command


def test_the_readme_names_every_topic_and_verb():
    text = (PROJECT / 'README.md').read_text()
    for verb in VERBS:
        assert f'binopos {verb}' in text
    for topic in ('target/pose', 'target/position', 'target/odometry', 'left/centroid'):
        assert f'`{topic}`' in text


def test_the_documents_name_every_topic_and_service_that_a_node_declares():
    documents = 'README.md', 'docs/calibration.md'
    text = ''.join((PROJECT / each).read_text() for each in documents)
    for path in PROJECT.glob('binopos_ros/nodes/*.py'):
        source = path.read_text()
        for name in re.findall(r"\.publisher\(\s*\w+, f?'([^']+)'", source):
            topic = name.replace('{side}', 'left')
            assert f'`{topic}`' in text, f'{path.name}: {topic}'
        for name in re.findall(r"create_service\(\w+, f?'([^']+)'", source):
            service = name.replace('{side}', 'left')
            assert f'`{service}`' in text or '{' in service, f'{path.name}: {service}'


def test_the_reference_is_made_of_all_that_is_declared(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(PROJECT / 'docs'))
    declared = importlib.import_module('declared')
    declared.write_reference(tmp_path)
    pages = {path.stem: path.read_text() for path in tmp_path.iterdir()}
    for node in NODES:
        for each in options_types(node):
            for name in specs_of(each):
                assert f'| `{name}` |' in pages['parameters'], name
    for verb in VERBS:
        assert f'usage: binopos {verb}' in pages['verbs']
    for name in ('optics.StereoRig', 'triangulation.triangulate', 'smoothing.make_filter'):
        assert f'### binopos_ros.{name}' in pages['api']
    long = [line for line in pages['verbs'].splitlines() if len(line) > 80]
    assert long == []


def test_every_page_has_its_place_on_the_site():
    index = (PROJECT / 'docs' / 'index.md').read_text()
    for path in PROJECT.glob('docs/*.md'):
        assert path.stem == 'index' or f'\n{path.stem}\n' in index, path.name


def test_no_document_names_a_place_on_somebodys_machine():
    for path in DOCUMENTS:
        assert not re.search(r'(?<![\w.])/(?:root|work|home/\w+)/', path.read_text()), path
