"""How all verbs take options: ROS's words, and the nearest match where a word is not known."""

from __future__ import annotations

import argparse
import difflib
from collections import deque
from collections.abc import Sequence
from typing import Any

ASSIGNS = ':='
PARAMETER = ('-p', '--param')


class VerbParser(argparse.ArgumentParser):
    """An argument parser whose refusals are those of the verb, with what may have been meant."""

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """As argparse's; but what a verb does not know is refused by the verb itself."""
        if self._subparsers is None:
            # Before argparse misses the argument that a slip of the pen was meant for.
            for word in args or ():
                if word.startswith('--') and len(word) > 2 and not self._begins(word):
                    self.error(self._unknown(word))
        parsed, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(self._unknown(unknown[0]))
        return parsed, unknown

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse a verb that does not exist with the nearest that does."""
        if isinstance(action, argparse._SubParsersAction) and value not in action.choices:
            known = list(action.choices)
            near = difflib.get_close_matches(str(value), known, n=1)
            hint = f'did you mean {near[0]!r}?' if near else f'known are {", ".join(known)}'
            self.error(f'there is no {action.metavar} {value!r}: {hint}')
        super()._check_value(action, value)

    def _begins(self, word: str) -> bool:
        option = word.partition('=')[0]
        return any(known.startswith(option) for known in self._option_string_actions)

    def _unknown(self, word: str) -> str:
        if not word.startswith('-'):
            return f'{word!r} is one argument too many'
        option = word.partition('=')[0]
        near = difflib.get_close_matches(option, self._option_string_actions, n=1)
        hint = f'did you mean {near[0]}?' if near else f'{self.prog} --help lists all'
        return f'there is no option {option}: {hint}'


def split_ros_arguments(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Part ROS's words from the verb's own.

    ROS's are those in `--ros-args ... [--]`, as rcl has it, and `-p NODE:NAME:=VALUE` anywhere.
    """
    own: list[str] = []
    ros: list[str] = []
    inside = False
    remaining = deque(words)
    while remaining:
        word = remaining.popleft()
        if word == '--ros-args':
            inside = True
        elif word == '--' and inside:
            inside = False
        elif inside:
            ros.append(word)
        elif word in PARAMETER and remaining and ASSIGNS in remaining[0]:
            ros += [word, remaining.popleft()]
        else:
            own.append(word)
    return own, ros
