"""The page's files: only these can be asked for, by these very names."""

from __future__ import annotations

from importlib import resources

TYPES = {
    '.html': 'text/html; charset=utf-8',
    '.js': 'text/javascript; charset=utf-8',
    '.css': 'text/css; charset=utf-8',
    '.svg': 'image/svg+xml',
}
FOLDER = 'page'
INDEX = 'index.html'


def load_pages() -> dict[str, tuple[str, bytes]]:
    """Path -> media type and content."""
    found = {}
    for file in resources.files('binopos_ros.view').joinpath(FOLDER).iterdir():
        kind = TYPES.get(file.name[file.name.rfind('.') :])
        if kind is not None:
            found[f'/{file.name}'] = (kind, file.read_bytes())
    found['/'] = found[f'/{INDEX}']
    return found
