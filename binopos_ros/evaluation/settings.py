"""How large an evaluation is."""

from __future__ import annotations

import dataclasses

from binopos_ros.evaluation.errors import EvaluationError

FEWEST_FRAMES = 40


@dataclasses.dataclass(frozen=True)
class Settings:
    """Numbers of runs; the paper's own are the defaults.

    Attributes:
        experiments: of each of the paper's three kinds.
        frames: pairs in each of them.
        sequences: unseen sequences in the comparison of filters.
        pixel_std: noise of the target's centre in each picture, px.
        seed: of everything random.
    """

    experiments: int = 100
    frames: int = 100
    sequences: int = 200
    pixel_std: float = 0.05
    seed: int = 2018

    def __post_init__(self) -> None:
        if self.experiments < 2 or self.sequences < 1:
            msg = (
                f'{self.experiments} experiments and {self.sequences} sequences compare nothing: '
                'give at least 2 experiments and 1 sequence'
            )
            raise EvaluationError(msg)
        if self.frames < FEWEST_FRAMES:
            msg = f'{self.frames} frames are too few to filter: give at least {FEWEST_FRAMES}'
            raise EvaluationError(msg)
        if not 0 < self.pixel_std <= 10:
            msg = f'the noise of the pixels is {self.pixel_std!r} px: give a value above 0, to 10'
            raise EvaluationError(msg)


#: A version that takes about a minute.
QUICK = Settings(experiments=20, sequences=20)
