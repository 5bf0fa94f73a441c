"""Lists of pictures, the left and the right one of a pair by turns."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

from binopos_ros.calibration.errors import CalibrationError

#: OpenCV's lists: its XML samples, and what FileStorage writes of a list of texts.
XML_LIST, YAML_LIST = '<imagelist>', re.compile(r'^%?YAML|^images:|^imagelist:', re.MULTILINE)
QUOTED = re.compile(r'"([^"]+)"')


def listed(path: Path) -> list[Path]:
    """The files that a list names, relative to its own folder: left and right by turns.

    Args:
        path: a text file with two names per line (those with blanks quoted, or parted from one
            another by a comma or a tab), or a list of OpenCV, XML or YAML.

    Raises:
        CalibrationError: it is no list, or no list of pairs.
    """
    try:
        text = path.read_text(encoding='utf-8-sig')
    except (OSError, UnicodeDecodeError):
        raise CalibrationError(
            f'{path} is neither a folder, a bag, a video, an archive nor a list of pictures'
        ) from None
    if XML_LIST in text:
        body = text.split(XML_LIST)[1].split('</imagelist>')[0]
        names = QUOTED.findall(body) or body.split()
    elif YAML_LIST.search(text):
        names = _of_yaml(text)
    else:
        names = _of_lines(text, path)
    if len(names) < 2 or len(names) % 2:
        raise CalibrationError(f'{path} lists {len(names)} pictures: pairs are needed')
    return [path.parent / name for name in names]


def _of_yaml(text: str) -> list[str]:
    """Names in `- name` lines, or in one list in brackets."""
    lines = [line.strip() for line in text.splitlines()]
    items = [line[1:].strip() for line in lines if line.startswith('-') and line != '---']
    if not items and '[' in text:
        items = text.split('[', 1)[1].split(']')[0].split(',')
    return [item.strip().strip('"\'') for item in items if item.strip()]


def _of_lines(text: str, path: Path) -> list[str]:
    names: list[str] = []
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith('#'):
            continue
        words = _words(line, path.parent)
        if len(words) != 2:
            raise CalibrationError(
                f'{path}, line {number}: write the left and the right picture of a pair; names '
                'with blanks in quotes'
            )
        names += words
    return names


def _words(line: str, folder: Path) -> list[str]:
    """The two names of a line; blanks may be in them where commas or tabs part them."""
    for mark in (',', '\t', ';'):
        words = [word.strip().strip('"\'') for word in line.split(mark)]
        if len(words) == 2 and all(words):
            return words
    try:
        words = shlex.split(line)
    except ValueError:
        words = line.split()
    if len(words) > 2:
        # Names with blanks that nobody quoted: the one place where both halves are files.
        parts = line.split(' ')
        halves = [(' '.join(parts[:i]), ' '.join(parts[i:])) for i in range(1, len(parts))]
        halves = [each for each in halves if all((folder / name).is_file() for name in each)]
        if len(halves) == 1:
            return list(halves[0])
    return words
