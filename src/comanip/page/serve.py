"""The page over HTTP, on this machine alone, for those who cannot open files. It serves one text and takes nothing."""

from __future__ import annotations

from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

HERE = "127.0.0.1"
_HEADERS = {
    "Content-Type": "text/html; charset=utf-8",
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
}


def server(page: str, port: int = 0) -> ThreadingHTTPServer:
    """A server of `page` on 127.0.0.1; port 0 takes a free one, `server_address` says which. OSError where it is taken."""
    content = page.encode("utf-8")

    class Handler(BaseHTTPRequestHandler):
        server_version, sys_version = "comanip", ""

        def do_GET(self) -> None:
            self._answer(content)

        def do_HEAD(self) -> None:
            self._answer(b"")

        def _answer(self, body: bytes) -> None:
            found = self._asked_here() and self.path.split("?")[0] in ("/", "/index.html", "/lift.html")
            body = body if found else b""
            self.send_response(200 if found else 404)
            for name, value in _HEADERS.items():
                self.send_header(name, value)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def _asked_here(self) -> bool:
            """Not by a page elsewhere whose name was made to lead here."""
            return self.headers.get("Host", "").rsplit(":", 1)[0] in (HERE, "localhost")

        def log_message(self, format: str, *args: Any) -> None:
            return

    return ThreadingHTTPServer((HERE, port), Handler)


def serve(page: str, port: int, said: Callable[[str], None]) -> None:
    """Serves until Control-C; `said` is told where."""
    with server(page, port) as running:
        said(f"http://{HERE}:{running.server_address[1]}/")
        running.serve_forever(poll_interval=0.2)
