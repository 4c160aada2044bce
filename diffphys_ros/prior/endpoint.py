"""A chat over an OpenAI-compatible HTTP endpoint (POST {base_url}/chat/completions), by the standard library alone."""

from __future__ import annotations

import http.client
import json
import urllib.error
import urllib.request
from collections.abc import Generator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

from ..errors import InputError, short
from .line import Line, TooLongError

LARGEST_ANSWER = 1 << 20  # bytes
TICK_S = 0.1  # how long one step of a request waits for the answer
WAIT_AGAIN = frozenset({408, 409, 425, 429, 500, 502, 503, 504})  # status codes after which the same request may succeed

Message = dict[str, Any]


class EndpointError(RuntimeError):
    """No answer. The message never holds the key nor what the server wrote; `passing` says whether to try again."""

    def __init__(self, message: str, *, passing: bool):
        super().__init__(message)
        self.passing = passing


@dataclass(frozen=True)
class Endpoint:
    """Where a model answers. Raises InputError for an address that is none."""

    base_url: str  # such as https://api.openai.com/v1
    model: str
    timeout_s: float  # for one whole request, answer included [s]
    key: str = field(default="", repr=False)  # empty: none is sent

    def __post_init__(self) -> None:
        if not _is_address(self.base_url):
            raise InputError(f"prior.base_url is {short(self.base_url)}, must begin with https:// or http:// and name a host, such as https://api.openai.com/v1")

    def asking(self, messages: Sequence[Message]) -> Generator[float, None, str]:
        """The text of the answer to a chat; yields 0 every TICK_S while there is none. To close the generator ends the request.

        Raises EndpointError, `timeout_s` after the beginning at the latest.
        """
        body = json.dumps({"model": self.model, "messages": list(messages)}).encode()
        request = urllib.request.Request(f"{self.base_url.rstrip('/')}/chat/completions", body, {"Content-Type": "application/json"})
        if self.key:
            request.add_unredirected_header("Authorization", f"Bearer {self.key}")
        return _content((yield from self._posted(request)))

    def _posted(self, request: urllib.request.Request) -> Generator[float, None, bytes]:
        line = Line(request, timeout_s=self.timeout_s, largest=LARGEST_ANSWER)
        try:
            while (answer := line.wait(TICK_S)) is None:
                yield 0.0
        except urllib.error.HTTPError as error:
            with closing(error):
                raise EndpointError(f"the endpoint answered with HTTP status {error.code}", passing=error.code in WAIT_AGAIN) from None
        except TooLongError:
            raise EndpointError(f"the answer is longer than {LARGEST_ANSWER} bytes", passing=True) from None
        except (OSError, http.client.HTTPException, ValueError) as error:
            raise self._lost(error) from None
        finally:
            line.give_up()
        return answer

    def _lost(self, error: Exception) -> EndpointError:
        reason = getattr(error, "reason", None)
        if isinstance(error, TimeoutError) or isinstance(reason, TimeoutError):
            return EndpointError(f"no whole answer within {self.timeout_s:g} s", passing=True)
        what = getattr(reason, "strerror", None) or type(reason or error).__name__
        return EndpointError(f"no connection to the endpoint ({what})", passing=not isinstance(error, ValueError))


def _is_address(url: str) -> bool:
    try:
        parts = urlsplit(url)
        return parts.scheme in ("http", "https") and bool(parts.hostname) and (parts.port or 1) > 0 and url.isprintable() and " " not in url
    except ValueError:  # brackets that do not close, a port that is no number
        return False


def _content(body: bytes) -> str:
    try:
        content = json.loads(body)["choices"][0]["message"]["content"]
    except (ValueError, KeyError, IndexError, TypeError, RecursionError):
        content = None
    if not isinstance(content, str):
        raise EndpointError("the answer is not that of a chat completion (choices[0].message.content)", passing=True)
    return content
