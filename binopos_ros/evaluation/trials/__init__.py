"""Trials of the filters: sequences with known truth, scores, and the bound no filter can beat.

Nothing here is needed to smooth; the tuning, the tests and `binopos evaluate` stand on it.
"""
