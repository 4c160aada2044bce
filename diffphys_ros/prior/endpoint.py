"""A chat over an OpenAI-compatible HTTP endpoint (POST {base_url}/chat/completions), by the standard library alone."""

from __future__ import annotations

import http.client
import json
import time
import urllib.error
import urllib.request
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from ..errors import InputError

LARGEST_ANSWER = 1 << 20  # bytes
CHUNK = 1 << 16  # bytes
WAIT_AGAIN = frozenset({408, 409, 425, 429, 500, 502, 503, 504})  # status codes after which the same request may succeed

Message = dict[str, Any]


class EndpointError(RuntimeError):
    """No answer. The message never holds the key nor what the server wrote; `passing` says whether to try again."""

    def __init__(self, message: str, *, passing: bool):
        super().__init__(message)
        self.passing = passing


class _NoRedirects(urllib.request.HTTPRedirectHandler):
    """A redirect would carry images and key to a server that nobody named."""

    def redirect_request(self, *args: Any, **kwargs: Any) -> None:
        return None


@dataclass(frozen=True)
class Endpoint:
    """Where a model answers."""

    base_url: str  # such as https://api.openai.com/v1
    model: str
    timeout_s: float  # for one whole request, answer included [s]
    key: str = field(default="", repr=False)  # empty: none is sent

    def __post_init__(self) -> None:
        if not self.base_url.startswith(("https://", "http://")):
            raise InputError(f"prior.base_url is {self.base_url!r}, must begin with https:// or http://, such as https://api.openai.com/v1")

    def ask(self, messages: Sequence[Message]) -> str:
        """The text of the answer to a chat. Raises EndpointError."""
        body = json.dumps({"model": self.model, "messages": list(messages)}).encode()
        request = urllib.request.Request(f"{self.base_url.rstrip('/')}/chat/completions", body, {"Content-Type": "application/json"})
        if self.key:
            request.add_unredirected_header("Authorization", f"Bearer {self.key}")
        return _content(self._posted(request))

    def _posted(self, request: urllib.request.Request) -> bytes:
        deadline = time.monotonic() + self.timeout_s
        try:
            with urllib.request.build_opener(_NoRedirects).open(request, timeout=self.timeout_s) as response:
                return _read(response, deadline)
        except urllib.error.HTTPError as error:
            error.close()
            raise EndpointError(f"the endpoint answered with HTTP status {error.code}", passing=error.code in WAIT_AGAIN) from None
        except TimeoutError:
            raise EndpointError(f"no whole answer within {self.timeout_s:g} s", passing=True) from None
        except (OSError, http.client.HTTPException, ValueError) as error:
            reason = getattr(error, "reason", None)
            if isinstance(reason, TimeoutError):
                raise EndpointError(f"no whole answer within {self.timeout_s:g} s", passing=True) from None
            what = getattr(reason, "strerror", None) or type(reason or error).__name__
            raise EndpointError(f"no connection to the endpoint ({what})", passing=not isinstance(error, ValueError)) from None


def _read(response: http.client.HTTPResponse, deadline: float) -> bytes:
    """The whole answer; a server that drips bytes does not outlive the deadline."""
    parts: list[bytes] = []
    while part := response.read1(CHUNK):
        parts.append(part)
        if sum(map(len, parts)) > LARGEST_ANSWER:
            raise EndpointError(f"the answer is longer than {LARGEST_ANSWER} bytes", passing=True)
        if time.monotonic() > deadline:
            raise TimeoutError
    return b"".join(parts)


def _content(body: bytes) -> str:
    try:
        content = json.loads(body)["choices"][0]["message"]["content"]
    except (ValueError, KeyError, IndexError, TypeError, RecursionError):
        content = None
    if not isinstance(content, str):
        raise EndpointError("the answer is not that of a chat completion (choices[0].message.content)", passing=True)
    return content
