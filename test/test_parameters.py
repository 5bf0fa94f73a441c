"""Options dataclasses as flat parameters: names, checks, refusals."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from binopos_ros.detection import DetectorOptions
from binopos_ros.parameters import ParameterError, build, specs_of
from binopos_ros.smoothing import FILTERS
from binopos_ros.smoothing.stage import SmootherOptions
from binopos_ros.triangulation.options import TriangulatorOptions


@dataclass(frozen=True)
class Inner:
    length: float = field(default=1.0, metadata={'unit': 'm', 'range': (0.0, 2.0)})
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Outer:
    count: int = field(default=3, metadata={'description': 'how many', 'range': (1, 9)})
    mode: str = field(default='a', metadata={'choices': ('a', 'b')})
    limit: float | None = None
    inner: Inner = field(default_factory=Inner)


def test_nested_options_have_dotted_names():
    assert list(specs_of(Outer)) == ['count', 'mode', 'limit', 'inner.length', 'inner.names']


def test_values_reach_their_fields_and_the_rest_keeps_its_default():
    options = build(Outer, {'inner.length': 2, 'inner.names': ['x'], 'mode': 'b', 'limit': None})
    assert options == Outer(mode='b', inner=Inner(2.0, ('x',)))
    assert isinstance(options.inner.length, float)


@pytest.mark.parametrize(
    ('values', 'words'),
    [
        ({'cuont': 1}, "unknown parameter 'cuont': did you mean 'count'"),
        ({'count': 10}, 'must lie in 1 .. 9'),
        ({'count': True}, 'give a int'),
        ({'count': 1.0}, 'give a int'),
        ({'inner.length': float('nan')}, 'finite'),
        ({'inner.length': 'long'}, 'give a float'),
        ({'inner.names': 'x'}, 'give a list'),
        ({'mode': 'c'}, 'choose one of a, b'),
    ],
)
def test_a_bad_value_is_refused_in_one_line_that_names_it(values, words):
    with pytest.raises(ParameterError) as caught:
        build(Outer, values)
    line = str(caught.value)
    assert words in line
    assert repr(next(iter(values))) in line
    assert '\n' not in line


@given(st.floats(0.0, 2.0), st.integers(1, 9))
def test_every_value_in_range_is_taken_as_it_is(length, count):
    options = build(Outer, {'inner.length': length, 'count': count})
    assert (options.inner.length, options.count) == (length, count)


OPTIONS = [DetectorOptions, TriangulatorOptions, SmootherOptions] + [
    each.options_class for each in FILTERS.values()
]


@pytest.mark.parametrize('options_type', OPTIONS, ids=lambda each: each.__name__)
def test_every_parameter_of_the_stages_is_described(options_type):
    for spec in specs_of(options_type).values():
        assert len(spec.description) > 5, spec.name
        if spec.kind in (int, float):
            assert spec.limits is not None, spec.name
