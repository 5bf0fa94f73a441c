"""Completion by the shell, with argcomplete: `register-python-argcomplete binopos`."""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping

#: The shell asks by it; argcomplete's own.
ASKED = '_ARGCOMPLETE'


def asked_verb(environment: Mapping[str, str]) -> str:
    """The verb of the line that the shell wants completed; '' where it asks for nothing."""
    words = environment.get('COMP_LINE', '').split() if ASKED in environment else []
    return words[1] if len(words) > 1 else ''


def complete(parser: argparse.ArgumentParser) -> None:
    """Answer the shell and end, where it asks."""
    if ASKED not in os.environ:
        return
    try:
        import argcomplete
    except ImportError:
        return
    argcomplete.autocomplete(parser)
