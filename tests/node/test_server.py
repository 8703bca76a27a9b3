"""Who is answered by a node: whoever names its token, and no page of a browser."""

import socket
import time
from pathlib import Path

import pytest
from nodes import application, asked, multipart, served
from pyodm.exceptions import NodeResponseError, NodeServerError

from photogram.node.node import Node, NodeSettings
from photogram.node.server import NodeServer, _NoPages, is_loopback
from photogram.node.work import openness


def test_only_whoever_names_the_token_is_answered(tmp_path: Path) -> None:
    with served(tmp_path, "secret of this node") as client:
        assert client.info().engine == "photogram"
        client.token = "another"
        with pytest.raises(NodeResponseError, match="Unauthorized"):
            client.info()
        client.token = ""
        for ask in (client.info, client.options, lambda: client.create_task([__file__], max_retries=0)):
            with pytest.raises(NodeResponseError, match="Unauthorized"):
                ask()


def test_every_address_needs_the_token_but_that_which_says_so(tmp_path: Path) -> None:
    app = application(Node(NodeSettings(tmp_path)), "secret")
    for route in app.routes:
        address = route.path.replace("{uuid}", "x").replace("{asset:path}", "all.zip")  # type: ignore[attr-defined]
        (method,) = route.methods - {"HEAD"}  # type: ignore[attr-defined]
        body = multipart({})
        for query in ({}, {"token": "secre"}, {"token": "secret "}):
            reply = asked(app, method, address, body, query=query)
            assert reply.status == (200 if address == "/auth/info" else 401), address
    assert asked(app, "GET", "/auth/info").json == {
        "message": "This node needs its token.", "loginUrl": None, "registerUrl": None,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("headers", "only_loopback", "status"),
    [
        ({}, True, 200),
        ({"host": "localhost:3000"}, True, 200),
        ({"host": "[::1]:3000"}, True, 200),
        ({"host": "evil.example:3000"}, True, 403),
        ({"host": "node.example:3000"}, False, 200),
        ({"origin": "http://evil.example"}, False, 403),
        ({"origin": "null"}, True, 403),
        ({"sec-fetch-site": "cross-site"}, False, 403),
        ({"sec-fetch-site": "none"}, True, 200),
    ],
)
def test_pages_of_a_browser_are_not_answered(
    tmp_path: Path, headers: dict[str, str], only_loopback: bool, status: int
) -> None:
    app = _NoPages(application(Node(NodeSettings(tmp_path))), only_loopback)
    assert asked(app, "GET", "/info", headers=headers).status == status


def test_a_port_that_is_taken_and_an_address_that_is_not_ones_own(tmp_path: Path) -> None:
    node = Node(NodeSettings(tmp_path))
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(OSError, match="in use"):
        NodeServer(node, "127.0.0.1", taken.getsockname()[1], "")
    with pytest.raises(OSError):  # noqa: PT011 - words of the system
        NodeServer(node, "192.0.2.1", 0, "")


def test_what_is_said_of_a_node_that_others_reach() -> None:
    assert is_loopback("127.0.0.1")
    assert is_loopback("::1")
    assert is_loopback("localhost")
    assert not is_loopback("0.0.0.0")
    assert not is_loopback("node.example")
    assert "Only this machine" in openness("127.0.0.1", "")[0]
    assert "takes tasks from anyone" in openness("0.0.0.0", "")[0]
    assert "unencrypted" in openness("0.0.0.0", "secret")[0]


def test_a_defect_is_said_and_the_server_lives_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    with served(tmp_path) as client:
        with monkeypatch.context() as patch:
            patch.setattr(Node, "info", lambda _: 1 // 0)
            patch.setattr(Node, "step", lambda _: 1 // 0)
            with pytest.raises(NodeServerError, match="500"):
                client.info()
            time.sleep(1.0)
        assert client.info().engine == "photogram"
        said = [record.getMessage() for record in caplog.records]
        assert "a defect of photogram, at /info" in said
        assert "a defect of photogram, in the queue of tasks" in said
        assert all(record.exc_info for record in caplog.records)


def test_requests_that_are_none_leave_the_server_alive(tmp_path: Path) -> None:
    with served(tmp_path) as client:
        for sent in (
            b"\0\xff" * 1000,
            b"POST /task/new HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000000\r\n\r\nx",
        ):
            with socket.create_connection(("127.0.0.1", client.port)) as connection:
                connection.sendall(sent)
        time.sleep(0.3)
        assert client.info().task_queue_count == 0
        assert not [path for path in (tmp_path / "uploads").iterdir() if not path.name.startswith(".")]
