"""Several walks on one page, each from its own, and a plan under them."""

import asyncio
import json
import struct
import zlib
from contextlib import closing

import pytest
from websockets.sync.client import connect

from fg_nav.errors import StreamError
from fg_nav.view import board
from fg_nav.view.board import BoardServer, Walker
from fg_nav.view.outlets import format_address, open_port
from fg_nav.view.plan import Plan
from fg_nav.view.servers import PageServer
from tests.browser import open_browser
from tests.view.lines import circle, now, status
from tests.view.serving import LOOP, Served
from tests.view.test_browser import wait
from tests.view.test_servers import HOST, WAIT_S, read, read_until, wait_for


def open_page(port=0):
    return Served(PageServer(HOST), open_port(HOST, port, "--port"))


def send_walk(page, lines, **more):
    for line in lines:
        page.send(line)
    last = json.loads(lines[-1])
    page.send_status(status(last["t"], last["position_m"], **more))


@pytest.fixture
def follow(monkeypatch):
    """Serve the board of some walkers."""
    monkeypatch.setattr(board, "RETRY_S", 0.05)
    ends = []

    def follow(*walkers):
        named = list(map(Walker.parse, walkers))
        served = Served(BoardServer(HOST, named), open_port(HOST, 0, "--port"))
        ends.append((served, [asyncio.run_coroutine_threadsafe(served.server.follow(one), LOOP) for one in named]))
        return served

    yield follow
    for served, tasks in ends:
        for task in tasks:
            task.cancel()
        served.close()


def png(width, height):
    """A white picture."""
    rows = b"".join(b"\0" + b"\xff" * width for _ in range(height))
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    parts = [(b"IHDR", head), (b"IDAT", zlib.compress(rows)), (b"IEND", b"")]
    chunks = (
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in parts
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def test_walkers_are_named_and_what_is_none_is_refused():
    for words, address, start in (
        ("anna=8642", "127.0.0.1:8642", (0.0, 0.0)),
        ("ben=10.0.0.5:8642@12,-3.5", "10.0.0.5:8642", (12.0, -3.5)),
        ("c d=http://[::1]:80/", "[::1]:80", (0.0, 0.0)),
    ):
        found = Walker.parse(words)
        assert (found.name, found.address, found.start_m) == (words.partition("=")[0], address, start)
    for words in ("8642", "=8642", "a=", "a=b", "a=b:c", "a=ftp://b:1", "a=1@2", "a=1@x,y"):
        with pytest.raises(StreamError, match="NAME=HOST:PORT"):
            Walker.parse(words)


def test_a_plan_lies_on_its_two_points(tmp_path):
    file = tmp_path / "plan.png"
    file.write_bytes(png(4, 3))
    plan = Plan.read(file, "100,200=10,20 300,200=10,40")  # rightward is north: a pixel is 0.1 m, down is east
    assert plan is not None
    found = plan.describe()
    right, down = found["right_m"], found["down_m"]
    assert [*right, *down] == pytest.approx([0.0, 0.1, 0.1, 0.0])
    for (px, py), place in (((100, 200), (10, 20)), ((300, 200), (10, 40)), ((100, 210), (11, 20))):
        at = [found["origin_m"][k] + px * right[k] + py * down[k] for k in (0, 1)]
        assert at == pytest.approx(place)
    assert Plan.read(None, None) is None
    for path, points, words in (
        (file, None, "two points"), (None, "1,2=3,4 5,6=7,8", "two points"), (file, "1,2=3,4", "lay no plan"),
        (file, "1,2=3,4 1,2=5,6", "lay no plan"), (file, "1,2=3,4 5,6=3,4", "lay no plan"),
        (tmp_path / "none.png", "0,0=0,0 1,1=1,1", "is no picture"), (tmp_path, "0,0=0,0 1,1=1,1", "is no picture"),
    ):  # fmt: skip
        with pytest.raises(StreamError, match=words):
            Plan.read(path, points)
    with pytest.raises(StreamError, match="--view"):
        Plan.read(file, "0,0=0,0 1,1=1,1", is_shown=False)


def test_a_board_shows_each_walk_whole_to_who_comes_late_and_again_after_a_break(follow):
    with closing(open_page()) as anna, closing(open_page()) as ben:
        served = follow(f"anna={anna.port}", f"ben={ben.port}@5,6")
        wait_for(lambda: len(served.server._heard) == 2)  # what is sent from here on is relayed line by line
        send_walk(anna, circle(12))
        with connect(f"ws://{HOST}:{served.port}/live", open_timeout=WAIT_S) as page:
            said = read_until(page, lambda event: event["kind"] == "walker" and event["walker"] == "ben")
            assert said["start_m"] == [5.0, 6.0]
            send_walk(ben, circle(7))
            assert read_until(page, lambda event: event.get("stance") == 6)["walker"] == "ben"
            anna.send_remark("this is odd.")
            assert read(page, {"remark"})["walker"] == "anna"
        with connect(f"ws://{HOST}:{served.port}/live", open_timeout=WAIT_S) as late:
            seen = {"anna": [], "ben": []}
            while (event := read(late))["kind"] != "walker" or event["walker"] == "anna":
                seen[event["walker"]].append(event)
            assert event["heard_s"] < WAIT_S
            for name, count in (("anna", 12), ("ben", 7)):
                rows = [row for event in seen[name] for row in event.get("path", ())]
                assert len(rows) + sum(event["kind"] == "now" for event in seen[name]) == count
            port = ben.port
            ben.close()
            with closing(open_page(port)) as again:
                send_walk(again, circle(9))
                told = read_until(
                    late, lambda event: event["walker"] == "ben" and (event.get("path") or event["kind"] == "now")
                )
                assert told["walker"] == "ben"


def test_a_team_is_seen_on_a_plan(follow, tmp_path):
    """On a phone: who walks, who stands, who is silent; a legend beside the banner; a click shows another's figures."""
    file = tmp_path / "plan.png"
    file.write_bytes(png(40, 30))
    plan = Plan.read(file, "0,30=-10,-10 40,30=30,-10")
    with closing(open_page()) as anna, closing(open_page()) as ben, open_browser() as browser:
        served = follow(f"anna={anna.port}", f"ben={ben.port}@20,0", "carla=1")
        served.server.show_plan([plan.path, plan.type, plan.describe()])
        send_walk(anna, circle(12))
        send_walk(ben, [now(0, 0.0, 0.0), now(1, 4.0, 0.0), now(3, 4.0, 0.0, continues=True)], source="ok")
        ben.send_status(status(13.5, [4.0, 0.0, 0.2], standing=True))
        page = browser.new_page(viewport={"width": 390, "height": 844})
        page.goto(format_address(HOST, served.port))
        wait(page, "plan.light && walks.size === 3 && walks.get('ben').status?.standing && banner.innerText")
        states = "[...document.querySelectorAll('#walkers .state')].map(state => state.innerText)"
        wait(page, f"{states}[1]?.startsWith('standing for 12 s') && {states}[2] === 'no contact with 127.0.0.1:1'")
        states = page.evaluate(states)
        assert states[0].startswith("walking, ")
        assert states[1].startswith("standing for 12 s · 4 m · floor")
        wait(page, "banner.innerText === 'carla: no contact with 127.0.0.1:1.'")
        ben.send_status(status(13.5, [4.0, 0.0, 0.2], source="silent 8 s"))
        wait(page, "banner.innerText.startsWith('ben: silent for 8 s')")
        boxes = "feet.hidden = false; const [a, b] = [feet, banner].map(one => one.getBoundingClientRect()); "
        wait(page, f"(() => {{ {boxes} return b.width && a.width && (a.right <= b.left || a.bottom <= b.top); }})()")
        page.click("#walkers li:nth-child(2) button")
        wait(page, "document.getElementById('east').innerText.startsWith('4.00')")
        # ben's start is 20 m east of anna's, and the plan's lower left corner at (-10, -10)
        east = page.evaluate("place(walks.get('ben'), 0, 0)[0] - place(walks.get('anna'), 0, 0)[0]")
        assert east == pytest.approx(20.0 * float(page.evaluate("view.scale")))
        assert page.evaluate("planCorners()[2]") == pytest.approx([-10.0, -10.0])
        for end in (anna, ben):  # both names lie at one place, and say no more
            end.send_status(status(13.5, [4.0, 0.0, 0.2], source="ended"))
        page.evaluate("walks.get('ben').start = [0, 0]")
        wait(page, "walks.get('anna').status.source === 'ended' && walks.get('ben').status.source === 'ended'")
        page.evaluate("show()")
        wait(page, "Math.abs(place(walks.get('ben'), 0, 0)[0] - place(walks.get('anna'), 0, 0)[0]) < 1")
        drawn = "const [a, b] = JSON.parse(canvas.dataset.labels); "
        wait(page, f"(() => {{ {drawn} return b && a[1] < 390 && b[1] - b[0] < 40 && b[2] - a[2] >= 16; }})()")
        page.close()
