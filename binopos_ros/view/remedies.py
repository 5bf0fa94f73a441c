"""What an operator does about an alarm.

What nodes say mostly ends in its own remedy ("plug it in again"); these are for what does not.
"""

from __future__ import annotations

import re

_REMEDIES = (
    (
        r'no circle|no red|not found|no target|contrast|candidate',
        'bring the red target into both pictures; turn lights away that glare, and look whether '
        'its colour is still red at this distance',
    ),
    (r'no position was used', 'look at both pictures: is the target in each of them?'),
    (
        r"standard deviation is .*'health.max_std'",
        'come closer, or let waves settle; binopos calibrate check tells whether the calibration '
        'still holds',
    ),
    (
        r'camera_info|calibrat',
        'binopos doctor --config FILE tells what is wrong with the calibration files',
    ),
    (r'no input', 'see whether the stage before it runs: binopos doctor'),
    (r'jumped back', 'set the time by chrony or PTP; press "reset filter" where poses stay out'),
    (r'clock|ahead of|behind', 'let chrony or PTP set the clocks of both machines'),
    (r'says nothing', 'binopos run starts a node that dies again; see what it printed'),
    (r'published by|second|another', 'end the other program, or set another ROS_DOMAIN_ID'),
    (r'lost on the way', 'the network or the shared memory is full: binopos doctor'),
)
#: Where that is why there is no target.
SWITCHED_OFF = 'the detector is switched off: press "Detector on" (service detector/start)'
_OF_WORDS = {
    'lost': 'bring the target into both pictures',
    'degraded': 'come closer to the target',
}


def remedy_for(text: str, word: str = '') -> str:
    """What to do about what a text tells, or about the target's health; '' where nothing helps."""
    for pattern, remedy in _REMEDIES:
        if re.search(pattern, text, re.IGNORECASE):
            return remedy
    return _OF_WORDS.get(word, '')
