"""Who may ask the server: the page that it served itself, by the name under which it was called."""

from collections.abc import Iterable

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK = frozenset(("127.0.0.1", "localhost", "[::1]"))
_EMPTY_STYLE = "'sha256-47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU='"
"""An empty style, which keeps OpenSeadragon from adding one."""
POLICY = (
    f"default-src 'none'; script-src 'self'; style-src 'self' {_EMPTY_STYLE}; img-src 'self' data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": POLICY,
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}


def allowed_hosts(host: str, port: int) -> frozenset[str]:
    """Return what a browser may call a server bound to ``host`` and ``port``.

    A server on this machine alone has the names of this machine; one that is bound to an address has that too. A page
    from elsewhere that has its own name lead here (DNS rebinding) calls it by another.
    """
    named = f"[{host}]" if ":" in host else host
    return frozenset(f"{name}:{port}" for name in {*LOOPBACK, named})


class Guard:
    """Refuses requests by another name, or of another page, and forbids pages whatever they do not need."""

    def __init__(self, app: ASGIApp, hosts: Iterable[str]) -> None:
        self._app = app
        self._hosts = frozenset(hosts)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or answer 403."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers[name] = value
            await send(message)

        if refused := self._refusal(Headers(scope=scope)):
            await PlainTextResponse(refused, status_code=403)(scope, receive, send_guarded)
        else:
            await self._app(scope, receive, send_guarded)

    def _refusal(self, headers: Headers) -> str:
        host, origin = headers.get("host", ""), headers.get("origin")
        if host.lower() not in self._hosts:
            return "this server goes by another name"
        if origin is not None and origin.lower() != f"http://{host.lower()}":
            return "another page asked for this"
        # a picture or a script on another page brings no origin, but browsers say where it stands
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return "another page asked for this"
        return ""
