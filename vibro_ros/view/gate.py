"""Who may see the live page and command through it, by checks of hosts, origins and tokens; and how much one may ask.

The server listens on this machine's loopback address, but every page that the user's browser has open can send
requests there. Three checks keep them out:

- The token is a secret in the page's address. A page of another site does not know it.
- The name in the `Host` header must be the machine itself. A site that lets its own name point to 127.0.0.1 (DNS
  rebinding) would otherwise pass for the same origin in the browser.
- A web socket must come from the page that this server has sent: its `Origin` must be the host that it talks to.
"""

import hmac
import ipaddress
import re
import secrets
import time
from collections.abc import Collection
from urllib.parse import urlsplit

RATE = 20.0
"""Messages a second that a page may send."""
BURST = 40.0
"""Messages that it may send at once after a rest."""
MOST_STRIKES = 100
"""Messages that were too many or meant nothing, after which a page is sent away; good ones make up for them."""

_HOST = re.compile(r"(?P<name>\[[0-9a-fA-F:.]{2,45}\]|[A-Za-z0-9._-]{1,253})(?::[0-9]{1,5})?")


class Gate:
    """The checks of one server that listens on `address`, by a secret `token` that is new for each server.

    `names` are those by which others reach this machine, if the server listens beyond it.
    """

    def __init__(self, address: str, names: Collection[str] = ()):
        self.token = secrets.token_urlsafe(16)
        self._loopback = is_loopback(address)
        self._names = {"localhost", *(() if self._loopback else (name.lower() for name in (address, *names)))}

    def knows_token(self, given: str) -> bool:
        """Whether `given` is the token; how long that takes tells nothing about it."""
        return hmac.compare_digest(given.encode(errors="replace"), self.token.encode())

    def knows_host(self, host: str) -> bool:
        """Whether a `Host` header names this machine.

        A number cannot be rebound: a page whose address has one comes from there. So numbers are taken, beyond the
        loopback ones only if the server listens there; names are taken only if they are known.
        """
        if not (match := _HOST.fullmatch(host)):
            return False
        name = match["name"].lower()
        try:
            number = ipaddress.ip_address(name.strip("[]"))
        except ValueError:
            return name in self._names
        return number.is_loopback or not (self._loopback or number.is_unspecified)

    def knows_origin(self, origin: str, host: str) -> bool:
        """Whether an `Origin` header is that of the page at `host`, which is known; the port may be a tunnel's."""
        try:
            parts = urlsplit(origin)
        except ValueError:
            return False
        return parts.scheme in ("http", "https") and origin.lower() == f"{parts.scheme}://{host.lower()}"


def is_loopback(address: str) -> bool:
    """Whether only this machine reaches what listens on `address`."""
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return address.lower() == "localhost"


class Allowance:
    """The allowance of one connection; `strikes` counts the messages that were refused lately."""

    def __init__(self):
        self.strikes = 0.0
        self._last, self._tokens = time.monotonic(), BURST

    def admits(self) -> bool:
        """Whether a message that has come now may be looked at."""
        now = time.monotonic()
        self._tokens = min(BURST, self._tokens + (now - self._last) * RATE)
        self._last = now
        if self._tokens < 1.0:
            self.strikes += 1.0
            return False
        self._tokens -= 1.0
        self.strikes = max(0.0, self.strikes - 0.1)
        return True
