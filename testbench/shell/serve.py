"""Named files over HTTP to browsers of this machine that know a word, and to nobody else."""

import contextlib
import secrets
from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from pathlib import Path, PurePosixPath
from socketserver import ThreadingTCPServer
from urllib.parse import unquote, urlsplit

from testbench.errors import BenchError

HERE = "127.0.0.1"  #: The only address that is listened on.
NAMES = (HERE, "localhost")
"""By which a browser may ask for it: under a stranger's name, made to lead here, his pages could read it."""
POLICY = (
    "default-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' data: blob:; "
    "frame-ancestors 'none'; form-action 'none'; base-uri 'none'"
)
"""What pages may load: nothing from elsewhere, so that they tell nobody of the run."""
KINDS = {
    ".js": "text/javascript; charset=utf-8",
    ".wasm": "application/wasm",
    ".png": "image/png",
    ".ico": "image/x-icon",
    ".rrd": "application/octet-stream",
}
"""Media type by suffix; a page where it is none of them."""


class Server(ThreadingTCPServer):
    """Listens from its making; `serve_forever` answers.

    Args:
        content: By path below the root, such as report.html: what it is, or the file, read whenever it is
            asked for.
        port: To listen on; 0 for a free one.

    Raises:
        BenchError: When the port is taken.
    """

    allow_reuse_address = True
    daemon_threads = True

    def __init__(self, content: Mapping[str, bytes | Path], port: int) -> None:
        self.content, self.token = content, secrets.token_urlsafe(24)
        try:
            super().__init__((HERE, port), Handler)
        except OSError as err:
            raise BenchError(f"--port: cannot listen on {HERE}:{port}: {err.strerror}") from err

    @property
    def port(self) -> int:
        """That it listens on."""
        return int(self.server_address[1])

    @property
    def root(self) -> str:
        """What addresses begin with: other users of this machine do not know the word in it."""
        return f"http://{HERE}:{self.port}/{self.token}/"

    def handle_error(self, *_: object) -> None:
        """A browser that leaves early is no error."""


class Handler(BaseHTTPRequestHandler):
    """Answers what is in the server's content, and of that alone."""

    server: Server
    server_version, sys_version = "testbench", ""
    timeout = 60.0

    def do_GET(self) -> None:
        """Send it."""
        content = self._content()
        if content is not None:
            self._say(len(content))
            if self.command != "HEAD":
                self.wfile.write(content)

    do_HEAD = do_GET

    def _content(self) -> bytes | None:
        """What was asked for; None where that was refused."""
        if self.headers.get("Host", "").partition(":")[0] not in NAMES:
            self.send_error(HTTPStatus.MISDIRECTED_REQUEST)
            return None
        token, _, path = unquote(urlsplit(self.path).path).removeprefix("/").partition("/")
        if not secrets.compare_digest(token.encode(), self.server.token.encode()):
            self.send_error(HTTPStatus.FORBIDDEN)
            return None
        found = self.server.content.get(path)
        with contextlib.suppress(OSError):  # it was there when the server began
            found = found.read_bytes() if isinstance(found, Path) else found
        if isinstance(found, bytes):
            return found
        self.send_error(HTTPStatus.NOT_FOUND)
        return None

    def _say(self, size: int) -> None:
        self.send_response(HTTPStatus.OK)
        suffix = PurePosixPath(urlsplit(self.path).path).suffix
        self.send_header("Content-Type", KINDS.get(suffix, "text/html; charset=utf-8"))
        self.send_header("Content-Length", str(size))
        self.end_headers()

    def end_headers(self) -> None:
        """Say with every answer what a page may do, and that it may change."""
        self.send_header("Content-Security-Policy", POLICY)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cache-Control", "no-store")
        super().end_headers()

    def log_message(self, *_: object) -> None:
        """Say nothing."""
