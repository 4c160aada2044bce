"""A real HTTP server on this machine that answers chats as a script says, well or badly."""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

Reply = Callable[[BaseHTTPRequestHandler], None]


def send(handler: BaseHTTPRequestHandler, body: bytes, status: int = 200, **headers: str) -> None:
    handler.send_response(status)
    for name, value in {"Content-Type": "application/json", "Content-Length": str(len(body)), **headers}.items():
        handler.send_header(name, value)
    handler.end_headers()
    handler.wfile.write(body)


def says(text: str) -> Reply:
    """A chat completion with this content."""
    return lambda handler: send(handler, json.dumps({"choices": [{"message": {"role": "assistant", "content": text}}]}).encode())


def status(code: int, **headers: str) -> Reply:
    """An HTTP status; the body repeats the key, as bad servers do."""
    return lambda handler: send(handler, f"denied: {handler.headers.get('Authorization')}".encode(), code, **headers)


def raw(body: bytes) -> Reply:
    return lambda handler: send(handler, body)


def silent(seconds: float) -> Reply:
    return lambda handler: time.sleep(seconds)


def dripping(seconds: float, every_s: float = 0.1) -> Reply:
    """A byte at a time, so that no single read times out."""

    def reply(handler: BaseHTTPRequestHandler) -> None:
        handler.send_response(200)
        handler.end_headers()
        for _ in range(round(seconds / every_s)):
            handler.wfile.write(b" ")
            handler.wfile.flush()
            time.sleep(every_s)

    return reply


OK = b"HTTP/1.1 200 OK\r\n"
CHUNKED = OK + b"Transfer-Encoding: chunked\r\n\r\n"


def endless(head: bytes, more: bytes, every_s: float = 0.0) -> Reply:
    """Bytes as they are, then others again and again for as long as somebody takes them."""

    def reply(handler: BaseHTTPRequestHandler) -> None:
        handler.connection.sendall(head)
        while True:
            handler.connection.sendall(more)
            time.sleep(every_s)

    return reply


def hang_up(handler: BaseHTTPRequestHandler) -> None:
    handler.connection.close()


class ChatServer:
    """Replies one after the other, the last one for ever; remembers what it was asked."""

    def __init__(self, *replies: Reply):
        self.replies, self.requests, self.headers, self.paths = list(replies), [], [], []
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                outer.requests.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
                outer.headers.append(dict(self.headers))
                outer.paths.append(self.path)
                reply = outer.replies.pop(0) if len(outer.replies) > 1 else outer.replies[0]
                with contextlib.suppress(OSError):  # the client may have gone, as it should
                    reply(self)

            def do_GET(self) -> None:
                outer.requests.append("GET")
                send(self, b"{}")

            def log_message(self, *args: Any) -> None:
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads, self.server.block_on_close = True, False
        self.thread = threading.Thread(target=self.server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
        self.url = f"http://127.0.0.1:{self.server.server_port}/v1"

    def __enter__(self) -> ChatServer:
        self.thread.start()
        return self

    def __exit__(self, *args: object) -> None:
        self.server.shutdown()
        self.server.server_close()
