"""`binopos record`: each word of the command line reaches the recorder under its own name."""

from __future__ import annotations

from typing import Any

import pytest

from verbs import binopos_here

pytest.importorskip('rclpy', reason='rclpy is not installed')

DEFAULTS = {'bag': 'dive'}


@pytest.fixture
def given(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the recorder would be started with."""
    told: dict[str, Any] = {}

    def record(words: list[str], parameters: list[Any]) -> int:
        told['words'] = words
        told.update({each.name: each.value for each in parameters})
        return 0

    monkeypatch.setattr('binopos_ros.nodes.recorder.record', record)
    return told


@pytest.mark.parametrize(
    ('words', 'expected'),
    [
        ((), {}),
        (('--all',), {'all': True}),
        (('--topics', '/a', '/b'), {'topics': ['/a', '/b']}),
        (
            ('--regex', 'left', '--exclude-regex', 'raw$'),
            {'regex': 'left', 'exclude_regex': 'raw$'},
        ),
        (('--compression', 'zstd'), {'compression': 'zstd'}),
        (('--max-bag-size', '1', '-d', '60'), {'max_bag_size': 1, 'max_bag_duration': 60.0}),
        (('-b', '0', '--max-bag-duration', '0'), {'max_bag_size': 0, 'max_bag_duration': 0.0}),
        (('--start-paused', '--snapshot', '30'), {'start_paused': True, 'snapshot': 30.0}),
        (('--min-free-space', '0'), {'min_free_space': 0}),
    ],
)
def test_a_word_is_the_parameter_of_its_name_and_no_other(given, words, expected):
    done = binopos_here('record', '-o', 'dive', *words)
    assert done.returncode == 0, done.stderr
    assert given.pop('words') == []
    assert given == DEFAULTS | expected


@pytest.mark.parametrize(
    'words', [('--all', '--topics', '/a'), ('--all', '--regex', 'a'), ('--max-bag-size', 'much')]
)
def test_words_that_contradict_each_other_are_refused(given, words):
    done = binopos_here('record', '-o', 'dive', *words)
    assert done.returncode == 2
    assert given == {}
