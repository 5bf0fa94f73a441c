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
    """Text that is no YAML, or none that is read here: one line, with its line where known."""


class _Loader(yaml.SafeLoader):
    """The safe loader without aliases, and with an end to nesting."""

    _depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        event = self.peek_event()
        if isinstance(event, yaml.AliasEvent):
            raise yaml.MarkedYAMLError(None, None, 'aliases are not read', event.start_mark)
        if self._depth >= DEEPEST:
            problem = f'nested more than {DEEPEST} levels deep'
            raise yaml.MarkedYAMLError(None, None, problem, event.start_mark)
        self._depth += 1
        try:
            return super().compose_node(parent, index)
        finally:
            self._depth -= 1


def load(text: str) -> Any:
    """What a YAML text says; None where it says nothing.

    Raises:
        PlainYamlError: no YAML, too long, nested too deep, or with aliases.
    """
    if len(text) > LONGEST:
        message = f'{len(text)} characters are too long: at most {LONGEST}'
        raise PlainYamlError(message)
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None)
        where = f'line {mark.line + 1}: ' if mark else ''
        problem = getattr(error, 'problem', None) or error
        message = f'{where}{" ".join(str(problem).split())}'
        raise PlainYamlError(message) from None
    except (ValueError, OverflowError, TypeError) as error:
        # A date that does not exist, a number with too many digits, a list as a key.
        message = ' '.join(str(error).split())
        raise PlainYamlError(message) from None
