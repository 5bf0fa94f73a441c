"""Results on disk, part by part, so that an evaluation that was stopped goes on where it was."""

from __future__ import annotations

import hashlib
import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from binopos_ros.evaluation.errors import EvaluationError

Arrays = dict[str, NDArray]


class Store:
    """A folder of parts, each a file of arrays that is valid for one question only.

    Args:
        folder: made where it is missing.

    Raises:
        EvaluationError: the folder cannot be made.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            msg = f'{folder} cannot be made: {error.strerror}; choose another folder with -o'
            raise EvaluationError(msg) from None

    def part(self, name: str, question: str, answer: Callable[[], Arrays]) -> Arrays:
        """The arrays of a part: from disk where the same question was answered, else anew.

        Args:
            name: of the part.
            question: all that the answer depends on, as text.
            answer: computes it.
        """
        key = hashlib.sha256(question.encode()).hexdigest()[:12]
        path = self._folder / f'{name}-{key}.npz'
        if path.is_file():
            try:
                with np.load(path) as file:
                    return {array: file[array] for array in file.files}
            except (OSError, ValueError, EOFError, zipfile.BadZipFile):
                # A file that was cut short: the part is computed again.
                path.unlink()
        arrays = answer()
        unfinished = path.with_suffix('.part')
        with unfinished.open('wb') as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]
        os.replace(unfinished, path)
        return arrays
