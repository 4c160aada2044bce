"""One POST over HTTP in a thread of its own, so that nothing a server does can hold up who waits for the answer."""

from __future__ import annotations

import contextlib
import http.client
import queue
import socket
import ssl
import threading
import time
import urllib.request
from functools import partial
from typing import Any

CHUNK = 1 << 16  # bytes


class TooLongError(RuntimeError):
    """The answer is longer than allowed."""


class Line:
    """A request under way. A socket's own timeout bounds single reads alone: a server that drips a byte at a time outlives it."""

    def __init__(self, request: urllib.request.Request, *, timeout_s: float, largest: int) -> None:
        self._request, self._timeout_s, self._largest = request, timeout_s, largest
        self._deadline = time.monotonic() + timeout_s
        self._answer: queue.SimpleQueue[bytes | BaseException] = queue.SimpleQueue()
        self._sockets: list[socket.socket] = []
        self._given_up = threading.Event()
        threading.Thread(target=self._run, name="prior's endpoint", daemon=True).start()

    def wait(self, seconds: float) -> bytes | None:
        """The answer, or None where there is none after `seconds`. Raises TimeoutError at the deadline, else what went wrong."""
        left = self._deadline - time.monotonic()
        try:
            answer = self._answer.get(timeout=max(min(seconds, left), 0.0))
        except queue.Empty:
            if time.monotonic() < self._deadline:
                return None
            raise TimeoutError from None
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def give_up(self) -> None:
        """End the connection, and with it the thread; does nothing after the answer."""
        self._given_up.set()
        while self._sockets:
            sock = self._sockets.pop()
            with contextlib.suppress(OSError):
                sock.shutdown(socket.SHUT_RDWR)
            sock.close()

    def _run(self) -> None:
        try:
            with _opener(self._connected).open(self._request, timeout=self._timeout_s) as response:
                self._answer.put(self._read(response))
        except BaseException as error:  # whoever waits is told
            self._answer.put(error)

    def _read(self, response: http.client.HTTPResponse) -> bytes:
        parts: list[bytes] = []
        while part := response.read1(CHUNK):
            parts.append(part)
            if sum(map(len, parts)) > self._largest:
                raise TooLongError
        return b"".join(parts)

    def _connected(self, *words: Any, **named: Any) -> socket.socket:
        """socket.create_connection; a second handle on the connection stays here, as TLS takes the first one away."""
        sock = socket.create_connection(*words, **named)
        self._sockets.append(sock.dup())
        if self._given_up.is_set():
            self.give_up()
        return sock


class _NoRedirects(urllib.request.HTTPRedirectHandler):
    """A redirect would carry images and key to a server that nobody named."""

    def redirect_request(self, *args: Any, **kwargs: Any) -> None:
        return None


def _opener(connect: Any) -> urllib.request.OpenerDirector:
    """Plain and TLS connections that `connect` opens, proxies of the environment included."""

    def made(kind: type[http.client.HTTPConnection], *words: Any, **named: Any) -> http.client.HTTPConnection:
        connection = kind(*words, **named)
        connection._create_connection = connect  # type: ignore[attr-defined]  # before a proxy's tunnel and TLS, which may drip too
        return connection

    class Plain(urllib.request.HTTPHandler):
        def http_open(self, request: urllib.request.Request) -> http.client.HTTPResponse:
            return self.do_open(partial(made, http.client.HTTPConnection), request)  # type: ignore[arg-type]

    class Tls(urllib.request.HTTPSHandler):
        def https_open(self, request: urllib.request.Request) -> http.client.HTTPResponse:
            return self.do_open(partial(made, http.client.HTTPSConnection), request, context=ssl.create_default_context())  # type: ignore[arg-type]

    return urllib.request.build_opener(_NoRedirects, Plain, Tls)
