"""Which of the paper's figures are reached here, by its own methods and by this suite's."""

from __future__ import annotations

import numpy as np

from binopos_ros.evaluation.cells import Cell, Span, Table, Value
from binopos_ros.evaluation.comparison import PAPER_FILTERS, error_ranges
from binopos_ros.evaluation.paper import PAPER_CALM, PAPER_SALT, PAPER_SMALLER
from binopos_ros.evaluation.run import Results

MILLI = 1e3
OWN, OURS, KALMAN = 'cloud-kalman-paper', 'cloud-kalman', 'kalman'
CLAIMED = PAPER_SMALLER[OURS, KALMAN]


def claims(results: Results) -> Table:
    """What the paper claims, what is found here, and whether that reaches it."""
    rows: list[tuple[Cell, ...]] = []

    def within(what: str, half: float, metres: np.ndarray) -> None:
        found = Span(MILLI * metres.min(), MILLI * metres.max())
        reached = max(-found.low, found.high) <= half
        rows.append((what, Span(-half, half), found, _word(reached)))

    for method, whose in (('paper', "the paper's rays"), ('refractive', 'refracted rays')):
        errors = results.transforming[method][:, 0]
        within(f'errors in calm water, {whose} (mm)', PAPER_CALM, errors)
    within('errors in salt water (mm)', PAPER_SALT, results.salted.errors['estimated'])
    for name in (OWN, OURS):
        smaller = _smaller(results, name)
        what = f'error range below Kalman, {PAPER_FILTERS[name]} (%)'
        rows.append((what, Value(CLAIMED), Value(smaller), _word(smaller >= CLAIMED)))
    return Table(
        'claims',
        "The paper's claims, and whether they are reached here",
        ('claim', 'paper', 'here', 'reached'),
        rows,
        plain_statement(results),
    )


def plain_statement(results: Results) -> str:
    """Whether the paper's own filter reaches what the paper claims of it, in plain words."""
    own, kalman = (_range(results, name) for name in (OWN, KALMAN))
    smaller = _smaller(results, OWN)
    if smaller >= CLAIMED:
        return (
            f"The paper's own filter reaches its claim: its error range is {smaller:.0f} % "
            f"smaller than Kalman's, where the paper has {CLAIMED:g} %."
        )
    return (
        "The paper's own filter does not reach the paper's claim: its error range is "
        f"{_than(smaller)} than Kalman's here ({own:.2f} mm against {kalman:.2f} mm), where the "
        f"paper has it {CLAIMED:g} % smaller. The range of this suite's default filter is "
        f"{_than(_smaller(results, OURS))} than Kalman's."
    )


def _smaller(results: Results, name: str) -> float:
    """By how much a filter's error range is below Kalman's, %."""
    return 100.0 * (1.0 - _range(results, name) / _range(results, KALMAN))


def _range(results: Results, name: str) -> float:
    """Mean error range over experiments and axes, mm."""
    return MILLI * float(error_ranges(results.fluctuating[name]).mean())


def _than(smaller: float) -> str:
    return f'{abs(smaller):.0f} % {"smaller" if smaller >= 0 else "larger"}'


def _word(reached: bool) -> str:
    return 'yes' if reached else 'no'
