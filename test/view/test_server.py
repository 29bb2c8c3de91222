"""The page over HTTP: what it serves, what it refuses, and that it runs nothing that a topic says."""

import dataclasses
import gzip
import http.client
import json
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from worlds.belief_factory import CLASSES, OBJECTS, belief_at, true_path

from semantic_slam.errors import InputError
from semantic_slam.view.live_run import LiveRun
from semantic_slam.view.server import ViewServer

HOSTILE = "<script>alert('x')</script><img src=http://evil.example/a.png>"


@pytest.fixture
def server() -> Iterator[ViewServer]:
    with ViewServer("127.0.0.1", 0, LiveRun("/belief")) as serving:
        thread = threading.Thread(target=lambda: serving.serve_forever(poll_interval=0.02))
        thread.start()
        yield serving
        serving.shutdown()
        thread.join()


def get(server: ViewServer, path: str, **headers: str) -> tuple[int, http.client.HTTPMessage, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.server_address[1], timeout=10)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    contents = answer.read()
    connection.close()
    return answer.status, answer.headers, contents


def changes(server: ViewServer, query: str = "") -> dict[str, Any]:
    return json.loads(get(server, f"/changes{query}")[2])


def test_the_page_has_all_its_parts_from_here(server: ViewServer) -> None:
    status, headers, contents = get(server, "/")
    assert status == 200 and headers["Content-Type"].startswith("text/html")
    policy = headers["Content-Security-Policy"]
    assert policy.startswith("default-src 'none'") and "unsafe" not in policy and "http" not in policy
    text = contents.decode()
    assert "style=" not in text and "<script>" not in text  # the policy would refuse both
    for part in ("/icon.svg", "/report.css", "/view.css", "/map.js", "/space.js", "/plots.js", "/view.js"):
        assert part in text and get(server, part)[0] == 200


def test_names_from_topics_are_data_or_escaped(server: ViewServer) -> None:
    names = ("crate", HOSTILE, "desk")
    belief = belief_at(3, true_path(24), names, (HOSTILE, *"234567"))
    server.run.add_belief(dataclasses.replace(belief, class_names=names))
    assert changes(server)["classes"][1]["name"] == HOSTILE
    status, headers, _ = get(server, "/changes")
    assert status == 200 and headers["Content-Type"] == "application/json"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert "<script" not in json.loads(get(server, "/charts")[2])["html"]


def test_a_browser_asks_for_what_is_new(server: ViewServer) -> None:
    path = true_path(24)
    for k in range(4):
        server.run.add_belief(belief_at(k, path, CLASSES, ("",) * len(OBJECTS)))
    first = changes(server)
    assert [frame["k"] for frame in first["frames"]] == [0, 1, 2, 3]
    again = changes(server, f"?session={first['session']}&version={first['version']}")
    assert again["frames"] == [] and again["version"] == first["version"]
    packed = get(server, "/changes", **{"Accept-Encoding": "gzip"})
    assert packed[1]["Content-Encoding"] == "gzip" and json.loads(gzip.decompress(packed[2])) | again
    assert len(packed[2]) < len(json.dumps(first)) / 2


@pytest.mark.parametrize(
    "path", ["/nothing", "/../setup.py", "/pictures/x/1.jpg", "/pictures/x/one.jpg", "/pictures/", "/changes?version=x"]
)
def test_what_is_not_there_is_not_found(server: ViewServer, path: str) -> None:
    assert get(server, path)[0] == 404


def test_a_foreign_name_for_this_machine_is_refused(server: ViewServer) -> None:
    """Else any page on the web could have its own name point here, and read what it likes."""
    assert get(server, "/", Host="evil.example")[0] == 421 and get(server, "/", Host="[")[0] == 400
    assert get(server, "/", Host="localhost:8321")[0] == get(server, "/", Host="[::1]")[0] == 200


def test_nothing_can_be_changed(server: ViewServer) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", server.server_address[1], timeout=10)
    connection.request("POST", "/changes", body=b"{}")
    assert connection.getresponse().status == 501
    connection.close()


def test_a_port_that_is_taken_is_one_line_with_a_remedy(server: ViewServer) -> None:
    with pytest.raises(InputError, match="Address already in use; choose others with --host and --port"):
        ViewServer("127.0.0.1", server.server_address[1], LiveRun())
