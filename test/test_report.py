"""The report that verbs end with: the pairs seen are the poses and one reason for each other."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from binopos_ros.pipeline import Dropped
from binopos_ros.report import Fates, Report

PERIOD = 33_333_333
REASONS = ('left: nothing red', 'right: JPEG of 12 bytes', 'smoother: too far')


@given(
    st.lists(st.tuples(st.booleans(), st.booleans(), st.integers(0, 3)), max_size=40),
    st.integers(0, 5_000_000),
)
def test_each_pair_that_gave_no_pose_counts_for_one_reason(frames, skew):
    report = Report(fates=Fates.within(0.01))
    pairs = poses = alone = 0
    for number, (left, right, fate) in enumerate(frames):
        stamps = {'left': 10**9 + number * PERIOD, 'right': 10**9 + number * PERIOD + skew}
        for side, here in (('left', left), ('right', right)):
            if here:
                report.fates.saw(side, stamps[side])
        if left and right:
            pairs += 1
            if fate < len(REASONS):
                # Both may be told of: the picture itself, and then that it had no partner.
                side = 'right' if fate == 1 else 'left'
                report.add(Dropped(stamps[side], REASONS[fate]))
                report.add(Dropped(stamps['left'], 'the left one has no partner'))
            else:
                poses += 1
                report.filtered.add(stamps['left'], (0.0, 0.0, 1.0))
        else:
            alone += left + right
    report.conclude()
    assert report.seen == pairs == poses + report.drops.total()
    assert report.fates.unpaired.total() == alone
    assert not any('partner' in reason for reason in report.drops)


def test_what_is_no_pair_is_told_apart():
    report = Report()
    report.add(Dropped(7, 'platform: no transform', of_pair=False))
    report.conclude()
    assert 'left out: platform: no transform' in str(report)
    assert not report.drops
