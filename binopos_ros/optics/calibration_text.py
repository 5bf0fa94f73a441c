"""The text of calibration files, whoever wrote them, as plain mappings.

Read are YAML, OpenCV's FileStorage (its YAML 1.0 with `!!opencv-matrix`, and its XML), and what
`ros2 topic echo` prints.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from binopos_ros import plain_yaml
from binopos_ros.optics.errors import OpticsError

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

PathLike = str | os.PathLike[str]
#: Matrices of FileStorage, and what it says before each document.
TAGS = ('!!opencv-matrix', '!!opencv-nd-matrix', '!<tag:yaml.org,2002:opencv-matrix>')
DIRECTIVE = '%YAML'
BOUNDARY = '---'


def text_of(path: PathLike) -> str:
    """The text of a file, UTF-8 or, as in comments of old files, Latin-1.

    Raises:
        OpticsError: it cannot be read, or is no text.
    """
    try:
        octets = Path(path).read_bytes()
    except OSError as error:
        msg = f'cannot read the calibration {path}: {error.strerror}'
        raise OpticsError(msg) from None
    try:
        return octets.decode('utf-8-sig')
    except UnicodeDecodeError:
        pass
    plain = sum(octet >= 0x20 or octet in b'\t\r\n' for octet in octets)
    if plain < len(octets) or sum(octet < 0x80 for octet in octets) <= len(octets) // 2:
        msg = f'{path} is no calibration file: it is not text'
        raise OpticsError(msg)
    return octets.decode('latin-1')


def write_lines(path: PathLike, lines: Iterable[str]) -> None:
    """Write a calibration file, UTF-8.

    Raises:
        OpticsError: it cannot be written.
    """
    try:
        Path(path).write_text('\n'.join(lines) + '\n', encoding='utf-8')
    except OSError as error:
        msg = f'cannot write {path}: {error.strerror}'
        raise OpticsError(msg) from None


def mapping_of(text: str, path: PathLike) -> dict[str, Any]:
    """What a calibration file says, by its keys.

    Raises:
        OpticsError: it is neither YAML nor FileStorage's XML, or has no keys.
    """
    data = _of_xml(text, path) if text.lstrip().startswith('<') else _of_yaml(text, path)
    if not isinstance(data, dict):
        msg = f'{path} is no camera_info file: it has no keys such as image_width'
        raise OpticsError(msg)
    return {str(key): value for key, value in data.items()}


def _of_yaml(text: str, path: PathLike) -> Any:
    # Messages of `ros2 topic echo` are parted by boundaries; the first one counts. Lines before
    # it are kept empty, so that an error names the right one.
    lines = [
        '' if line.startswith(DIRECTIVE) or line.strip() == '...' else line
        for line in text.splitlines()
    ]
    begun = False
    for i, line in enumerate(lines):
        if line.rstrip() == BOUNDARY:
            if begun:
                lines = lines[:i]
                break
            lines[i] = ''
        elif line.strip() and not line.lstrip().startswith('#'):
            begun = True
    plain = '\n'.join(lines)
    for tag in TAGS:
        plain = plain.replace(tag, '')
    try:
        return plain_yaml.load(plain)
    except plain_yaml.PlainYamlError as error:
        where = f', line {error.line}' if error.line else ''
        msg = f'{path}{where} is not valid YAML: {error.problem}'
        raise OpticsError(msg) from None


def _of_xml(text: str, path: PathLike) -> dict[str, Any]:
    # Few calibrations are XML.
    from xml.etree import ElementTree

    if len(text) > plain_yaml.LONGEST or '<!ENTITY' in text:
        msg = f'{path} is no calibration file: it is too long, or defines entities'
        raise OpticsError(msg)
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        msg = f'{path} is not valid XML: {error}'
        raise OpticsError(msg) from None
    if root.tag != 'opencv_storage':
        msg = (
            f'{path} is XML of <{root.tag}>; of XML only FileStorage of OpenCV is read '
            '(<opencv_storage>)'
        )
        raise OpticsError(msg)
    return {each.tag: _value(each) for each in root}


def _value(element: Element) -> Any:
    """An element's text, its words where there are several, or a mapping of what is in it."""
    if len(element):
        return {each.tag: _value(each) for each in element}
    words = (element.text or '').split()
    # A matrix of one number is a list all the same.
    return words if element.tag == 'data' or len(words) > 1 else ''.join(words)
