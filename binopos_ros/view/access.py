"""Who may look: a token where others can reach the port, and no page of somebody else's."""

from __future__ import annotations

import hmac
import ipaddress
import os
import secrets
import socket
from collections.abc import Collection, Mapping
from urllib.parse import parse_qs, urlsplit

TOKEN_BYTES = 16
#: Environment variable in which a supervisor gives a viewer the token that it keeps when it is
#: started again, so that pages which are open know it still.
TOKEN_VARIABLE = 'BINOPOS_VIEW_TOKEN'


class Access:
    """Judges requests by their token, the page that sends them and the name they call us by.

    Args:
        listen: address that is served on.
        token: asked for where not '' ; '' and an address that others reach: made here.
        origins: of pages beside our own that may read.
    """

    def __init__(self, listen: str, token: str = '', origins: Collection[str] = ()) -> None:
        kept = os.environ.get(TOKEN_VARIABLE) or new_token()
        self.token = token or ('' if is_own(listen) else kept)
        self._origins = {each.rstrip('/').lower() for each in origins}
        self._listen = listen.lower()

    def refusal(self, path: str, headers: Mapping[str, str], *, guarded: bool) -> str:
        """Why a request is refused, '' where it is not; a token is for what is `guarded`."""
        host = headers.get('Host', '')
        if not self.token and not self._is_ours(host):
            # A name that leads here only in the resolver of an attacker's victim, whose browser
            # would take his page for ours. Where there is a token, he does not know it.
            return 'unknown host'
        origin = headers.get('Origin', '').lower()
        if origin and origin not in self._origins and urlsplit(origin).netloc != host.lower():
            return 'foreign origin'
        if guarded and self.token and not self._knows(path, headers):
            return 'wrong token'
        return ''

    def _knows(self, path: str, headers: Mapping[str, str]) -> bool:
        given = parse_qs(urlsplit(path).query).get('token', [''])[0]
        bearer = headers.get('Authorization', '')
        if bearer.startswith('Bearer '):
            given = bearer.removeprefix('Bearer ')
        return hmac.compare_digest(given.encode(), self.token.encode())

    def _is_ours(self, host: str) -> bool:
        try:
            name = (urlsplit(f'//{host}').hostname or '').lower()
        except ValueError:
            return False
        own = socket.gethostname().lower()
        names = {'localhost', own, own.partition('.')[0], f'{own}.local', self._listen}
        return name in names or is_address(name)


def new_token() -> str:
    """A token that nobody guesses."""
    return secrets.token_urlsafe(TOKEN_BYTES)


def is_own(address: str) -> bool:
    """Whether an address is reached from this machine alone."""
    if address == 'localhost':
        return True
    return is_address(address) and ipaddress.ip_address(address).is_loopback


def is_address(name: str) -> bool:
    """Whether a name is an address in figures."""
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
