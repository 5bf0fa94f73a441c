"""Reasons as keys: figures struck out, names of formats kept, and never as many as are sent."""

from __future__ import annotations

import secrets
from collections import Counter

import pytest

from binopos_ros.reasons import LONGEST_REASON, MOST_KINDS, OTHER, count_reason, kind_of


@pytest.mark.parametrize(
    ('reason', 'kind'),
    [
        ("encoding '8UC3' is unknown", "encoding '8UC3' is unknown"),
        ('encoding mono16 has no colour', 'encoding mono16 has no colour'),
        ('width 33 of nv12', 'width # of nv12'),
        ('the image is 640x480, not 1280x960', 'the image is #x#, not #x#'),
        ('contrast 0.31 or -1.5e-3', 'contrast # or #'),
        ('a\nb\x00c', 'a?b?c'),
    ],
)
def test_figures_are_struck_out_and_names_kept(reason, kind):
    assert kind_of(reason) == kind


def test_neither_number_nor_length_of_kinds_is_up_to_the_sender():
    counts: Counter[str] = Counter()
    for _ in range(1000):
        count_reason(counts, f"encoding '{secrets.token_hex(5000)}' is unknown")
    for _ in range(1000):
        count_reason(counts, f'bad word {secrets.token_hex(30)}')
    assert counts.total() == 2000
    assert len(counts) <= MOST_KINDS + 1
    assert counts[OTHER] > 0
    assert max(map(len, counts)) <= LONGEST_REASON + 3
