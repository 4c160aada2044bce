"""Nothing that a server does holds up a request beyond its time, and whoever asks can give up at once."""

from __future__ import annotations

import socket
import threading
import time

import pytest

from diffphys_ros.config import build
from diffphys_ros.prior import believing
from diffphys_ros.prior.endpoint import Endpoint, EndpointError
from diffphys_ros.prior.model import NoAnswerError, ask
from diffphys_ros.progress import waiting

from .conftest import GOOD
from .server import CHUNKED, OK, ChatServer, endless, says, silent, status

TIMEOUT_S, MUCH_LATER_S = 0.3, 10.0
CONTINUE = b"HTTP/1.1 100 Continue\r\n\r\n"
REPLIES = {
    "status line dripped": endless(b"HTTP/1.1 200 ", b"O", 0.02),
    "header dripped": endless(OK + b"X: ", b"x", 0.02),
    "headers for ever": endless(OK, b"X: y\r\n", 0.02),
    "continue for ever": endless(b"", CONTINUE),
    "continue for ever, slowly": endless(b"", CONTINUE, 0.02),
    "headers of continue for ever": endless(b"HTTP/1.1 100 Continue\r\n", b"X: y\r\n", 0.02),
    "chunk size dripped": endless(CHUNKED, b"0", 0.02),
    "chunk extension dripped": endless(CHUNKED + b"1;", b"x", 0.02),
    "trailers for ever": endless(CHUNKED + b"0\r\n", b"X: y\r\n", 0.02),
    "body dripped": endless(OK + b"\r\n", b" ", 0.02),
    "nothing": silent(60.0),
}


@pytest.fixture(autouse=True)
def environment(monkeypatch, tmp_path):
    monkeypatch.setenv("NO_PROXY", "127.0.0.1,localhost")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def settings(url: str, **changes):
    values = {"prior.base_url": url, "prior.model": "seer-1", "experiment.prior_timeout_s": TIMEOUT_S, "experiment.prior_attempts": 1}
    return build(values | {f"experiment.prior_{k}" if k in ("timeout_s", "attempts", "cache") else f"prior.{k}": v for k, v in changes.items()})


def connections() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name == "prior's endpoint"]


def ended() -> bool:
    """Whether no thread of a request is left, after a while if need be."""
    until = time.monotonic() + MUCH_LATER_S
    while connections() and time.monotonic() < until:
        time.sleep(0.01)
    return not connections()


@pytest.mark.parametrize("reply", REPLIES.values(), ids=REPLIES)
def test_a_request_ends_at_its_deadline_and_its_connection_with_it(frame, labels, reply) -> None:
    with ChatServer(reply) as server:
        began = time.monotonic()
        with pytest.raises(NoAnswerError, match=r"no whole answer within 0.3 s|no connection"):
            ask(frame, labels, settings(server.url))
        assert time.monotonic() - began < MUCH_LATER_S
        assert ended()


def test_a_tls_handshake_that_never_comes_ends_at_the_deadline(frame, labels) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        with pytest.raises(NoAnswerError, match=r"no whole answer within 0.3 s"):
            ask(frame, labels, settings(f"https://127.0.0.1:{listening.getsockname()[1]}/v1"))
        assert ended()


def test_a_proxy_that_drips_its_answer_ends_at_the_deadline(frame, labels, monkeypatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as proxy:
        monkeypatch.setenv("https_proxy", f"http://127.0.0.1:{proxy.getsockname()[1]}")
        with pytest.raises(NoAnswerError, match=r"no whole answer within 0.3 s"):
            ask(frame, labels, settings("https://model.invalid/v1"))
        assert ended()


def test_to_stop_iterating_ends_the_request_at_once(clip) -> None:
    with ChatServer(silent(60.0)) as server:
        steps = waiting("body", believing(clip, settings(server.url, timeout_s=600.0)))
        assert next(steps).stage == "body"
        assert len(connections()) == 1
        began = time.monotonic()
        steps.close()
        assert ended()
        assert time.monotonic() - began < MUCH_LATER_S


def test_to_stop_iterating_ends_a_pause_between_requests_too(clip) -> None:
    with ChatServer(status(503)) as server:
        steps = believing(clip, settings(server.url, timeout_s=60.0, attempts=10))
        while len(server.requests) < 2:  # a second lies between the first two
            next(steps)
        began = time.monotonic()
        steps.close()
        assert time.monotonic() - began < 0.9


def test_an_answer_in_time_is_taken_and_leaves_no_connection(frame, labels) -> None:
    with ChatServer(says(GOOD)) as server:
        assert len(ask(frame, labels, settings(server.url, timeout_s=60.0))) == 2
        assert ended()


def test_a_node_can_cancel_while_a_model_answers(clip) -> None:
    worker = pytest.importorskip("diffphys_ros.nodes.worker")
    with ChatServer(silent(60.0)) as server:
        job = worker.Worker()
        job.start(lambda: waiting("body", believing(clip, settings(server.url, timeout_s=600.0))))
        while not server.requests:
            time.sleep(0.01)
        job.cancel(wait_s=MUCH_LATER_S)
        assert [event.kind for event in job.poll() if event.kind != worker.NEWS] == [worker.CANCELLED]
        assert ended()


@pytest.mark.parametrize("url", ["http://[::1", "http://", "https:///v1", "http://a:port", "http://a b/", "http://a\0b", "http://a\r\nX: y", "ftp://a", "a", "http://a:99999"])
def test_what_is_no_address_is_refused(url) -> None:
    from diffphys_ros.errors import InputError

    with pytest.raises(InputError, match=r"prior\.base_url is .*, must begin with https://"):
        Endpoint(url, "seer-1", 1.0)


def test_a_key_that_no_header_can_carry_is_told_without_it() -> None:
    steps = Endpoint("http://127.0.0.1:9/v1", "seer-1", 5.0, key="sk-\nsecret").asking([])
    with pytest.raises(EndpointError, match=r"no connection to the endpoint \(ValueError\)"):
        list(steps)
