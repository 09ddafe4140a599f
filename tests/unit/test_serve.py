"""Files over HTTP: to this machine, under its own names, to who knows the word, and no other files."""

import http.client
import threading
from urllib.parse import quote

import pytest

from testbench.errors import BenchError
from testbench.shell.serve import Server


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    tmp_path = tmp_path_factory.mktemp("run")
    (tmp_path / "secret.txt").write_text("secret")
    (tmp_path / "page.html").write_text("<p>page")
    content = {"": b"start", "page.html": tmp_path / "page.html", "gone.png": tmp_path / "gone.png"}
    with Server(content, 0) as made:
        thread = threading.Thread(target=made.serve_forever, args=(0.02,))
        thread.start()
        yield made
        made.shutdown()
        thread.join()


def ask(server, path, host="127.0.0.1", method="GET", token=None):
    path = f"/{server.token}{path}" if token is None else f"{token}{path}"
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    connection.request(method, path, headers={"Host": host})
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer, content


def test_what_is_named_is_served_and_may_load_nothing_from_elsewhere(server):
    answer, content = ask(server, "/page.html?run=1")
    assert (answer.status, content) == (200, b"<p>page")
    assert answer.headers["Content-Type"].startswith("text/html")
    policy = answer.headers["Content-Security-Policy"]
    assert "default-src 'self'" in policy
    assert "http" not in policy
    assert "form-action 'none'" in policy  # of a stranger's page: default-src says nothing of forms
    assert ask(server, "/", method="HEAD")[0].headers["Content-Length"] == "5"


@pytest.mark.parametrize(
    "path",
    ["/secret.txt", "/../secret.txt", "/%2e%2e/secret.txt", "//secret.txt", "/page.html/", "/gone.png"],
)
def test_nothing_else_is_found(server, path):
    answer, content = ask(server, path)
    assert answer.status == 404
    assert b"secret" not in content


def test_it_listens_on_this_machine_only_and_answers_to_its_own_names_only(server):
    assert server.server_address[0] == "127.0.0.1"
    assert ask(server, "/", f"localhost:{server.port}")[0].status == 200
    for stranger in ("evil.example", f"evil.example:{server.port}", "127.0.0.1.evil.example", ""):
        answer, content = ask(server, "/", stranger)
        assert (answer.status, b"start" in content) == (421, False)


def test_who_does_not_know_the_word_gets_nothing(server):
    assert len(server.token) >= 32
    assert server.root == f"http://127.0.0.1:{server.port}/{server.token}/"
    for token in ("", "/", f"/{server.token[:-1]}", f"/{server.token}x", f"/x/{server.token}", "/é"):
        for path in ("/", "/page.html", "/nothing"):
            answer, content = ask(server, path, token=quote(token))
            assert (answer.status, b"page" in content, b"start" in content) == (403, False, False)
    with Server({}, 0) as other:
        assert other.token != server.token


def test_a_taken_port_is_one_line(server):
    with pytest.raises(BenchError, match=f"--port: cannot listen on 127.0.0.1:{server.port}: "):
        Server({}, server.port)
