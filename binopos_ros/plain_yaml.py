"""YAML that somebody else wrote: bounded in size, depth and kind, so that reading it always ends.

What people write into parameter files, calibrations and a bag's metadata is plain: no anchors, a
few levels of nesting. Aliases let a hundred bytes stand for gigabytes, and deep nesting takes the
interpreter's stack.
"""

from __future__ import annotations

from typing import Any

import yaml

#: Levels of nesting; the suite's own files have six.
DEEPEST = 64
#: Characters; a bag of ten thousand files is described by a third of it.
LONGEST = 4 << 20


class PlainYamlError(ValueError):
    """Text that is no YAML, or none that is read here.

    Attributes:
        problem: what is wrong with it, one line.
        line: where, from 1 on; None where that is not known.
    """

    def __init__(self, problem: str, line: int | None = None) -> None:
        super().__init__(problem if line is None else f'line {line}: {problem}')
        self.problem = problem
        self.line = line


#: libyaml's, where PyYAML was built with it: ten times as fast.
_Loader = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


def load(text: str) -> Any:
    """What a YAML text says; None where it says nothing.

    Raises:
        PlainYamlError: no YAML, too long, nested too deep, or with aliases.
    """
    if len(text) > LONGEST:
        raise PlainYamlError(f'{len(text)} characters are too long: at most {LONGEST}')
    try:
        _refuse_traps(text)
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None)
        # libyaml finds what is missing at the end on a line of its own.
        line = min(mark.line, text.count('\n')) + 1 if mark else None
        problem = ' '.join(str(getattr(error, 'problem', None) or error).split())
        raise PlainYamlError(problem, line) from None
    except (ValueError, OverflowError, TypeError) as error:
        # A date that does not exist, a number with too many digits, a list as a key.
        raise PlainYamlError(' '.join(str(error).split())) from None


def _refuse_traps(text: str) -> None:
    """Look the text over before anything is built of it, as far as the first trap."""
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        problem = ''
        if isinstance(event, yaml.AliasEvent):
            problem = 'aliases are not read'
        elif isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > DEEPEST:
                problem = f'nested more than {DEEPEST} levels deep'
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if problem:
            raise yaml.MarkedYAMLError(None, None, problem, event.start_mark)
