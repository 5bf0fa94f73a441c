"""What the paper prints in its Sec. 5.2 to 5.4: Figures 13 to 21, Tables 5 and 6."""

from __future__ import annotations

#: mm; errors lie within so much to either side: in calm water, in salt water, under waves.
PAPER_CALM, PAPER_SALT = 4.0, 0.37
PAPER_WAVES = {'none': 3.3, 'kalman': 3.3, 'cloud-kalman': 2.5}
#: Lowest and highest index of Figure 17.
PAPER_INDICES = (1.33, 1.52)
#: %; by how much an assumed index raises the error.
PAPER_GROWTH = 12.45
#: %; by how much one filter's error range is below another's.
PAPER_SMALLER = {
    ('kalman', 'none'): 10.67,
    ('cloud-kalman', 'kalman'): 23.34,
    ('cloud-kalman', 'none'): 31.73,
}
PAPER_TABLE_5 = {
    'cloud-kalman': (97, 4.36, 5548.95),
    'sage-husa': (2, 4.73, 5672.62),
    'bp-kalman': (1, 4.64, 5590.16),
}
PAPER_TABLE_6 = {
    -1.0: (0, 2, 1),
    -0.5: (3, 2, 2),
    0.5: (7, 3, 3),
    1.0: (85, 87, 91),
    1.5: (4, 6, 2),
    2.0: (1, 0, 1),
}
