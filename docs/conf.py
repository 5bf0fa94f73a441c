"""The site: `make docs`. Nothing is fetched while it is built, and warnings are errors."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from declared import write_reference  # noqa: E402

import binopos_ros  # noqa: E402

project = 'binopos_ros'
author = 'binopos_ros maintainers'
copyright = 'binopos_ros maintainers, Apache-2.0'
release = version = binopos_ros.__version__
extensions = ['myst_parser']
source_suffix = {'.md': 'markdown'}
exclude_patterns = ['figures/**.md']
myst_heading_anchors = 4
myst_enable_extensions = ['colon_fence']
html_theme = 'furo'
html_title = f'binopos_ros {release}'
html_show_sourcelink = False

write_reference(HERE / 'reference')


def on_source_read(app: Any, name: str, source: list[str]) -> None:
    """Lead links to the repository's root to their pages on the site."""
    source[0] = source[0].replace('](../SECURITY.md', '](reference/policy.md')


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect('source-read', on_source_read)
