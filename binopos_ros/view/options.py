"""What the operator's page may be told."""

from __future__ import annotations

from dataclasses import dataclass

from binopos_ros.parameters import check_options, option
from binopos_ros.view.errors import ViewError

PORT = 8470


@dataclass(frozen=True)
class ViewerOptions:
    """Where the page is served, to whom, and what it may do."""

    listen: str = option(
        '127.0.0.1',
        'address to serve on; any but this machine alone asks viewers for a token, which is '
        'printed at the start',
        read_only=True,
    )
    port: int = option(PORT, 'port to serve on, 0: any', limits=(0, 65535), read_only=True)
    token: str = option(
        '', 'what viewers have to know; empty: made anew at each start', read_only=True
    )
    buttons: bool = option(
        True, 'let viewers press buttons; without, the page only shows', read_only=True
    )
    folder: str = option(
        '',
        'where recordings and still pairs go that are asked for on the page; empty: the folder '
        'that the viewer was started in',
        read_only=True,
    )
    picture_rate: float = option(
        30.0, 'pictures per second, camera and viewer at the most', 'Hz', (0.1, 1000.0)
    )
    max_picture_size: int = option(
        8 << 20, 'larger pictures are not shown', 'bytes', limits=(1 << 10, 1 << 30)
    )
    max_clients: int = option(16, 'pages and feeds that may be open at once', limits=(1, 1000))
    origins: tuple[str, ...] = option(
        (),
        'other pages that may read from this one, such as http://blueos.local of a cockpit',
        read_only=True,
    )

    def __post_init__(self) -> None:
        check_options(self, ViewError)
