"""Results on disk: kept for the question they answer, and never half-written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from binopos_ros.evaluation import EvaluationError, Store


class Answer:
    """Counts how often it was asked."""

    def __init__(self) -> None:
        self.asked = 0

    def __call__(self) -> dict[str, np.ndarray]:
        self.asked += 1
        return {'values': np.arange(4) * self.asked}


def test_a_part_is_computed_once_for_one_question(tmp_path: Path) -> None:
    answer = Answer()
    first = Store(tmp_path).part('filter', 'size 3', answer)
    again = Store(tmp_path).part('filter', 'size 3', answer)
    assert answer.asked == 1
    np.testing.assert_array_equal(first['values'], again['values'])


def test_another_question_is_another_part(tmp_path: Path) -> None:
    answer = Answer()
    store = Store(tmp_path)
    store.part('filter', 'size 3', answer)
    other = store.part('filter', 'size 4', answer)
    assert answer.asked == 2
    np.testing.assert_array_equal(other['values'], 2 * np.arange(4))


def test_a_part_that_was_cut_short_is_computed_again(tmp_path: Path) -> None:
    answer = Answer()
    Store(tmp_path).part('filter', 'size 3', answer)
    file = next(tmp_path.iterdir())
    file.write_bytes(file.read_bytes()[:60])
    found = Store(tmp_path).part('filter', 'size 3', answer)
    assert answer.asked == 2
    np.testing.assert_array_equal(found['values'], 2 * np.arange(4))


def test_a_part_that_fails_leaves_nothing(tmp_path: Path) -> None:
    def fail() -> dict[str, np.ndarray]:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Store(tmp_path).part('filter', 'size 3', fail)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / 'file').write_text('')
    with pytest.raises(EvaluationError, match='choose another folder'):
        Store(tmp_path / 'file' / 'parts')
