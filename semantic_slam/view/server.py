"""The page over HTTP: a handful of addresses, read only."""

import gzip
import json
import socket
import sys
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from ipaddress import ip_address
from typing import Any
from urllib.parse import SplitResult, parse_qsl, urlsplit

from semantic_slam.errors import InputError, MessageError
from semantic_slam.view.live_run import LiveRun
from semantic_slam.view.page import assets

HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self';"
    " connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
JSON, JPEG = "application/json", "image/jpeg"
SMALL = 1000
"""Bytes that are not worth being compressed."""
MOST_DIGITS = 16
PATIENCE_S = 30.0
"""After which a browser that says nothing is forgotten."""

REMEDIES = {HTTPStatus.MISDIRECTED_REQUEST: ": ask by the machine's IP address, or start with --host NAME"}

Answer = tuple[str, bytes]
"""Media type and contents."""


class ViewServer(ThreadingHTTPServer):
    """Serves one run to any number of browsers, each in a thread of its own."""

    daemon_threads = True
    block_on_close = False

    def __init__(self, host: str, port: int, run: LiveRun) -> None:
        """Port 0: any that is free. Raises InputError."""
        self.run = run
        self.files = assets()
        short = socket.gethostname().lower()
        self.own_names = {"localhost", host.lower(), short, f"{short}.local", socket.getfqdn().lower()}
        try:
            self.address_family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
            super().__init__((host, port), Handler)
        except (OSError, OverflowError) as fault:
            reason = getattr(fault, "strerror", None) or str(fault).rstrip(".")
            raise InputError(f"{host} port {port}: {reason}; choose others with --host and --port") from None

    @property
    def address(self) -> str:
        """Where a browser finds the page."""
        host, port = self.server_address[:2]
        shown = {"0.0.0.0": socket.gethostname(), "::": socket.gethostname()}.get(str(host), str(host))
        return f"http://{f'[{shown}]' if ':' in shown else shown}:{port}/"

    @property
    def is_of_this_machine(self) -> bool:
        """Whether no other machine reaches it."""
        return ip_address(str(self.server_address[0]).partition("%")[0]).is_loopback

    def is_meant(self, name: str) -> bool:
        """Whether a request names this machine: a page of a foreign name that was pointed here must not read ours."""
        return name in self.own_names or _is_address(name)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say what went wrong; a browser that went away is no fault."""
        if not isinstance(sys.exception(), (ConnectionError, TimeoutError)):
            super().handle_error(request, client_address)


class Handler(BaseHTTPRequestHandler):
    """One request."""

    server: ViewServer
    protocol_version = "HTTP/1.1"
    timeout = PATIENCE_S

    def do_GET(self) -> None:
        try:
            name, asked = urlsplit(f"//{self.headers.get('Host', '')}").hostname, urlsplit(self.path)
        except ValueError:
            self.refuse(HTTPStatus.BAD_REQUEST)
            return
        if not self.server.is_meant(name or ""):
            self.refuse(HTTPStatus.MISDIRECTED_REQUEST)
            return
        try:
            answer = self.answer(asked)
        except MessageError:  # a picture that does not decode
            answer = None
        if answer is None:
            self.refuse(HTTPStatus.NOT_FOUND)
        else:
            self.send(HTTPStatus.OK, *answer)

    def answer(self, asked: SplitResult) -> Answer | None:
        """What lies at the address that is asked for; None where there is nothing. Raises MessageError."""
        if asked.path in self.server.files:
            return self.server.files[asked.path]
        if asked.path == "/changes":
            query = dict(parse_qsl(asked.query))
            version = query.get("version", "0")
            return (
                as_json(self.server.run.changes(query.get("session", ""), int(version))) if is_number(version) else None
            )
        if asked.path == "/charts":
            return as_json(self.server.run.charts())
        folder, _, name = asked.path.removesuffix(".jpg").rpartition("/")
        found = self.server.run.picture(folder.removeprefix("/pictures/"), int(name)) if is_number(name) else None
        return (JPEG, found) if found is not None else None

    def refuse(self, status: HTTPStatus) -> None:
        self.close_connection = True
        self.send(status, "text/plain; charset=utf-8", f"{status.phrase}{REMEDIES.get(status, '')}\n".encode())

    def send(self, status: HTTPStatus, kind: str, contents: bytes) -> None:
        packed = kind != JPEG and len(contents) > SMALL and "gzip" in self.headers.get("Accept-Encoding", "")
        contents = gzip.compress(contents, 5) if packed else contents
        self.send_response(status)
        for name, value in HEADERS.items():
            self.send_header(name, value)
        if packed:
            self.send_header("Content-Encoding", "gzip")
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(contents)))
        self.end_headers()
        self.wfile.write(contents)

    def version_string(self) -> str:
        return "semantic_slam"

    def log_message(self, format: str, *words: Any) -> None:
        """Nothing: requests come several times a second."""


def as_json(value: Any) -> Answer:
    return JSON, json.dumps(value, allow_nan=False).encode()


def is_number(text: str) -> bool:
    """Whether a keyframe or a version may be meant."""
    return text.isascii() and text.isdigit() and len(text) < MOST_DIGITS


def _is_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True
