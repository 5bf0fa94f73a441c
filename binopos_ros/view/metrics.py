"""The numbers for other programs: Prometheus text, and `name=value` lines for a cockpit."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from binopos_ros.view.screen import STALE

AXES = ('x', 'y', 'z')
HEALTH = ('starting', 'tracking', 'coasting', 'degraded', 'lost')


class Metric(NamedTuple):
    """One figure under its names."""

    name: str  #: with its unit
    kind: str  #: 'gauge' or 'counter'
    help: str
    value: float
    labels: Mapping[str, str] = {}


def metrics_of(numbers: Mapping[str, Any]) -> list[Metric]:
    """The figures out of `Screen.numbers`; nan for what is not known."""
    # What is shown as a number now must not be of some time ago.
    pose = numbers['pose'] if numbers['age'] < STALE else None
    pose = pose or {'position': [math.nan] * 3, 'deviation': [math.nan] * 3}
    index = numbers['index'] or {'mean': math.nan, 'std': math.nan}
    gauges = [
        *(
            Metric(f'position_{axis}_metres', 'gauge', f'Target, {axis}.', pose['position'][n])
            for n, axis in enumerate(AXES)
        ),
        *(
            Metric(
                f'deviation_{axis}_metres',
                'gauge',
                f'Standard deviation of {axis}.',
                pose['deviation'][n],
            )
            for n, axis in enumerate(AXES)
        ),
        Metric('age_seconds', 'gauge', 'Since the newest pose came.', numbers['age']),
        Metric('distance_metres', 'gauge', 'From the left camera.', numbers['distance']),
        Metric('speed_metres_per_second', 'gauge', 'Of the target.', numbers['speed']),
        Metric('rate_hertz', 'gauge', 'Poses per second.', numbers['rate']),
        Metric(
            'latency_median_seconds',
            'gauge',
            'From the picture to its pose.',
            numbers['latency']['median'],
        ),
        Metric('latency_p99_seconds', 'gauge', 'As the median.', numbers['latency']['p99']),
        Metric('refractive_index', 'gauge', 'Of the medium.', index['mean']),
        Metric('refractive_index_deviation', 'gauge', 'Of the index.', index['std']),
        Metric('waves_pixel_noises', 'gauge', "Waves in the rays' miss.", numbers['waves']),
    ]
    word = numbers['health']['word']
    gauges += [
        Metric(
            'health', 'gauge', 'One for the word that holds.', float(each == word), {'word': each}
        )
        for each in HEALTH
    ]
    gauges += [
        Metric(
            'dropped_total',
            'counter',
            'What gave no result.',
            float(each['count']),
            {'node': each['node'], 'reason': each['reason']},
        )
        for each in numbers['drops']
    ]
    return gauges


def prometheus(metrics: Iterable[Metric]) -> str:
    """Prometheus's text format, version 0.0.4."""
    lines: list[str] = []
    seen = ''
    for metric in metrics:
        name = f'binopos_{metric.name}'
        if name != seen:
            lines += [f'# HELP {name} {metric.help}', f'# TYPE {name} {metric.kind}']
            seen = name
        labels = ','.join(f'{key}="{_escaped(value)}"' for key, value in metric.labels.items())
        value = 'NaN' if math.isnan(metric.value) else repr(metric.value)
        lines.append(f'{name}{f"{{{labels}}}" if labels else ""} {value}')
    return '\n'.join([*lines, ''])


def feed(numbers: Mapping[str, Any]) -> list[str]:
    """`name=value` lines; what is not known is left out, so that nothing old is shown as new."""
    known = [
        f'binopos_{each.name}={each.value:.6g}'
        for each in metrics_of(numbers)
        if not each.labels and math.isfinite(each.value)
    ]
    return [*known, f'binopos_health={numbers["health"]["word"] or "unknown"}']


def _escaped(value: str) -> str:
    return value.replace('\\', r'\\').replace('"', r'\"').replace('\n', r'\n')
