"""The page in a real browser: what it shows of a walk, and of what goes wrong with it."""

import json
import re
import time
from contextlib import closing
from itertools import pairwise

import pytest

from fg_nav.view.outlets import format_address, open_port
from fg_nav.view.servers import PageServer
from tests.browser import open_browser
from tests.view.lines import circle, now, status
from tests.view.serving import Served

HOST = "127.0.0.1"
WAIT_S = 30.0


def open_page(port=0):
    return Served(PageServer(HOST), open_port(HOST, port, "--port"))


@pytest.fixture(scope="module")
def browser():
    with open_browser() as opened:
        yield opened


@pytest.fixture
def server():
    with closing(open_page()) as opened:
        yield opened


@pytest.fixture
def visit(browser):
    """Open the page of a server; at the end no page has complained, and none has asked for anything elsewhere."""
    opened, said, asked = [], [], []

    def visit(server, width=1280, scheme="dark"):
        page = browser.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme)
        page.set_default_timeout(1e3 * WAIT_S)
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", lambda request: asked.append(request.url))
        page.on("websocket", lambda live: asked.append(live.url))
        page.goto(format_address(HOST, server.port))
        wait(page, "canvas.dataset.state === 'connected'")
        opened.append(page)
        return page

    yield visit
    for page in opened:
        page.close()
    lost = [words for words in said if "ERR_CONNECTION" in words or "WebSocket connection" in words]
    assert said == lost, "the console"
    assert [url for url in asked if not re.match(r"(http|ws)://127\.0\.0\.1:\d+/|data:", url)] == []


def wait(page, condition):
    """Ask until it holds; the page's own policy forbids a condition in words inside of it."""
    deadline = time.monotonic() + WAIT_S
    while not page.evaluate(condition):
        assert time.monotonic() < deadline, condition
        page.wait_for_timeout(20)


def send_walk(server, lines, **more):
    for line in lines:
        server.send(line)
    last = json.loads(lines[-1])
    server.send_status(status(last["t"], last["position_m"], **more))


def count_pixels(page, name):
    """Pixels of the map that have a color of the page."""
    return page.evaluate(
        """name => {
            const rgb = getComputedStyle(document.documentElement).getPropertyValue(name).trim().match(/[0-9a-f]{2}/g);
            const [r, g, b] = rgb.map(x => parseInt(x, 16));
            const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d", {willReadFrequently: true});
            copy.drawImage(canvas, 0, 0);
            const data = copy.getImageData(0, 0, canvas.width, canvas.height).data;
            let count = 0;
            for (let i = 0; i < data.length; i += 4) count += data[i] === r && data[i + 1] === g && data[i + 2] === b;
            return count;
        }""",
        name,
    )


def ellipse_of(page):
    return json.loads(page.evaluate("canvas.dataset.ellipse"))


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_a_walk_is_shown_as_it_goes_on(visit, server, width, scheme):
    page = visit(server, width, scheme)
    assert count_pixels(page, "--path") == 0
    send_walk(server, circle(20), standing=True)
    wait(page, "canvas.dataset.points === '20' && canvas.dataset.ellipse")
    first, few = ellipse_of(page), count_pixels(page, "--path")
    assert few > 300
    # 95 % of a Gaussian of sigmas 0.1 and 0.2 m, correlated by 0.25
    assert (first["a"], first["b"]) == pytest.approx((0.4952, 0.2348), abs=1e-3)
    assert page.inner_text("#stance") == "Stands"
    assert page.inner_text("#trust") == "Path trusted"
    assert page.locator("#trust-reason").is_hidden()
    assert page.locator("#losses").is_hidden()
    assert page.inner_text("#field") == "Field undisturbed"
    assert page.inner_text("#latency") == "8ms"
    assert page.inner_text("#floor") == "+1"
    assert page.inner_text("#source") == "source sends"
    server.send(now(20, 0.0, -3.0))
    assert page.inner_text("#returns") == "0"
    server.send_status(status(20.2, [0.5, -3.5, -0.001], floor=-2, heading_deg=359.7, returns=[[10.0, 20.0, 0.0, 9.0]]))
    wait(page, "canvas.dataset.points === '21' && document.getElementById('stance').innerText === 'Swings'")
    moved = ellipse_of(page)
    assert (moved["east"], moved["north"]) == (0.5, -3.5)
    assert count_pixels(page, "--path") != few
    assert page.inner_text("#north-m") == "−3.50m"
    assert (page.inner_text("#height"), page.inner_text("#heading")) == ("0.00m", "0°")
    assert page.inner_text("#floor") == "−2"
    assert page.inner_text("#returns") == "1"
    assert page.inner_text("#returns-words") == "recognized by the field, longest 00:10"
    assert page.evaluate("document.scrollingElement.scrollWidth") <= width
    assert page.locator("#banner").is_hidden()
    sizes = page.evaluate(
        "[...document.querySelectorAll('p, h1, h2, small, output, b, button, li, #scale')]"
        ".map(element => parseFloat(getComputedStyle(element).fontSize))"
    )
    assert min(sizes) >= 12.0
    boxes = page.evaluate(
        "[...panel.children].filter(child => !child.hidden).map(child => child.getBoundingClientRect())"
        ".map(box => [box.top, box.bottom])"
    )
    assert all(above[1] <= below[0] + 1 for above, below in pairwise(boxes))
    buttons = page.evaluate(
        "[...tools.children].map(child => child.getBoundingClientRect()).map(box => [box.top, box.right])"
    )
    assert len({top for top, _ in buttons}) == 1
    assert max(right for _, right in buttons) <= width


def test_who_comes_late_sees_the_past_and_a_revised_one(visit, server):
    early = visit(server)
    send_walk(server, circle(30))
    late = visit(server)
    for page in (early, late):
        wait(page, "canvas.dataset.points === '30'")
        assert page.evaluate("walk.path[29][1]") == pytest.approx(json.loads(circle(30)[29])["position_m"][0], abs=1e-3)
    server.send(json.dumps({"kind": "turned", "t": 29.0, "angle_deg": 90.0}))
    server.send(json.dumps({"kind": "retracted", "stance": 7, "t": 7.0}))
    server.send(json.dumps({"kind": "revised", "t": 29.0, "path": [[0.0, 0.0, 0.0, 0.0], [29.0, 9.0, 8.0, 1.0]]}))
    for page in (early, late):
        wait(page, "canvas.dataset.points === '29' && walk.path[28][1] === 9")
        assert page.inner_text("#notice") == "A false footfall was taken back."


def test_what_is_wrong_is_shown(visit, server):
    page = visit(server)
    server.send(now(0, 0.0, 0.0))
    reasons = ["a stride of 3.1 m, at 24.0 s: it drifted", "one", "two"]
    server.send(now(1, 1.0, 0.0, field="disturbed", floor=None, verdict="not to be used", reasons=reasons))
    lost = {"lost_samples": 1, "lost_datagrams": 20}
    server.send_status(status(1.0, [1.0, 0.0, 0.0], source="silent 7 s", floor=None, **lost))
    server.send_remark("nothing has come from <b>a test</b> for 7 s: waiting.")
    wait(page, "document.querySelector('#remarks li')")
    assert page.inner_text("#field") == "Field disturbed"
    assert page.inner_text("#field-reason") == "as asked"
    assert page.inner_text("#trust") == "Path not to be used"
    assert page.inner_text("#trust-reason") == "A stride of 3.1 m, at 24.0 s: it drifted; one; and 1 more."
    assert page.inner_text("#losses") == "Lost so far: 1 sample, 20 datagrams."
    assert page.inner_text("#floor") == "–"
    assert page.inner_text("#banner") == "The source is silent for 7 s."
    assert page.inner_text("#remarks li") == "nothing has come from <b>a test</b> for 7 s: waiting."
    server.send_status(status(1.1, [1.0, 0.0, 0.0]))
    wait(page, "banner.hidden")
    server.send_status(status(1.2, [1.0, 0.0, 0.0], source="ended"))
    wait(page, "!banner.hidden")
    assert page.inner_text("#banner") == "The walk has ended."


def test_a_server_that_begins_again_is_found_again_with_the_whole_path(visit):
    with closing(open_page()) as server:
        page = visit(server)
        send_walk(server, circle(12))
        wait(page, "canvas.dataset.points === '12'")
    wait(page, "canvas.dataset.state === 'lost'")
    assert page.inner_text("#banner").startswith("Connection lost")
    assert page.evaluate("canvas.dataset.points") == "12"
    with closing(open_page(server.port)) as again:
        send_walk(again, circle(25))
        wait(page, "canvas.dataset.state === 'connected' && canvas.dataset.points === '25'")
        assert page.locator("#banner").is_hidden()


def test_the_map_is_moved_turned_and_zoomed(visit, server):
    page = visit(server)
    send_walk(server, circle(30))
    wait(page, "canvas.dataset.points === '30'")
    scale = float(page.evaluate("canvas.dataset.scale"))
    page.mouse.move(400, 300)
    page.mouse.wheel(0, -500)
    wait(page, f"canvas.dataset.scale > {1.5 * scale}")
    page.click("#zoom-out")
    page.keyboard.press("-")
    page.keyboard.press("-")
    wait(page, f"canvas.dataset.scale < {scale}")
    page.click("#follow")
    wait(page, "view.east === walk.status.position_m[0]")
    assert page.get_attribute("#follow", "aria-pressed") == "true"
    page.mouse.move(400, 300)
    page.mouse.down()
    page.mouse.move(440, 300)
    page.mouse.up()
    moved = page.evaluate("(walk.status.position_m[0] - view.east) * view.scale")
    assert moved == pytest.approx(40.0, abs=1.0)
    assert page.get_attribute("#follow", "aria-pressed") == "false"
    page.keyboard.press("u")
    wait(page, "view.turn !== 0")
    (_, north), (_, before) = page.evaluate("[walk.path.at(-1), walk.path.at(-2)].map(row => project(row[1], row[2]))")
    assert before > north  # the way of walking is up
    page.keyboard.press("a")
    wait(page, "view.mode === 'all'")
    inside = page.evaluate(
        "walk.path.map(row => project(row[1], row[2]))"
        ".every(([x, y]) => x > 0 && y > 0 && x < size.width && y < size.height)"
    )
    assert inside
