"""The page of a reproduction: all is in it, nothing comes from elsewhere, and it fits a desk, a phone and paper."""

import base64
import re
from html.parser import HTMLParser
from io import BytesIO

import pytest
from matplotlib.image import imread

from fg_nav.errors import OutputError
from fg_nav.lab.reproduce.command import write_page
from fg_nav.lab.reproduce.results import format_name, format_note
from tests.browser import open_browser
from tests.lab.reproduce.made import reproduction

VOID = {"meta", "link", "img", "br", "hr"}


class Read(HTMLParser):
    """Tags with their attributes, texts by the element they stand in, and whether every tag is closed."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.texts, self.open = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs), tuple(self.open)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag, f"</{tag}> closes another"

    def handle_data(self, data):
        if data.strip():
            self.texts.append((self.open[-1] if self.open else "", data.strip()))

    def of(self, name):
        return [attributes for tag, attributes, _ in self.tags if tag == name]

    def said(self, *elements):
        return [text for element, text in self.texts if element in elements]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("page")


@pytest.fixture(scope="module")
def found(folder):
    return reproduction(folder)


@pytest.fixture(scope="module")
def text(found, folder):
    return write_page(found, folder)


def test_all_is_in_the_page_and_nothing_comes_from_elsewhere(text, found):
    read = Read(text)
    # tags are closed, ids are one, links and sources are in the page, what is wide has a box of its own
    assert read.open == []
    ids = [attributes["id"] for _, attributes, _ in read.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert {link["href"].removeprefix("#") for link in read.of("a")} <= set(ids)
    assert not re.search(r"https?:|@import|url\(|<script|<iframe|<object", text)
    for tag, attributes, inside in read.tags:
        assert all(re.match(r"data:|#", attributes.get(name, "#")) for name in ("src", "href", "srcset"))
        assert "style" not in attributes
        assert tag != "table" or inside[-1] == "div"
    boxes = [attributes for attributes in read.of("div") if attributes.get("class") == "scroll"]
    assert len(boxes) == len(read.of("table"))
    assert all(box["tabindex"] == "0" and box["role"] == "region" and box["aria-labelledby"] for box in boxes)
    # pictures with their captions
    captions = [picture.caption for experiment in found.experiments for picture in experiment.pictures]
    assert [image["alt"] for image in read.of("img")] == captions == read.said("figcaption")
    for image in read.of("img"):
        content = base64.b64decode(image["src"].removeprefix("data:image/png;base64,"), validate=True)
        height, width = imread(BytesIO(content), format="png").shape[:2]
        assert (image["width"], image["height"]) == (str(width), str(height))
    # rows with paper, columns, verdict and reason
    rows = [row for experiment in found.experiments for row in experiment.rows]
    columns = [c for e in found.experiments for c in ("Figure", "Paper", *e.columns, "Verdict")]
    assert [head for head in read.said("th") if head not in columns] == [format_name(row) for row in rows]
    verdicts = [text.split(" ", 1)[1] for text in read.said("span") if re.fullmatch(r"[=+~×] .*", text)]
    assert verdicts == [row.verdict for row in rows if row.verdict]
    assert set(verdicts) == {"reproduced", "better", "missed (explained)", "missed"}
    assert {format_note(row) for row in rows} - {""} <= set(read.said("span"))
    assert {"0.55", "(0.50 to 0.60)", "never"} <= set(read.said("span"))
    assert read.said("strong") == ["1", "1", "1", "2"]
    # what differs, and what it was made with
    shown = " ".join(text for _, text in read.texts)
    for words in (*found.differs, found.citation, found.command, "101, 102, 103", "fg-nav 0.1.0", '"sigma": 0.5'):
        assert words in shown


def test_a_picture_that_is_not_there_is_shown_in_one_sentence(found, tmp_path):
    with pytest.raises(OutputError, match=r"one\.png is not there, or is no PNG"):
        write_page(found, tmp_path)


@pytest.fixture(scope="module")
def browser():
    with open_browser() as opened:
        yield opened


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (1280, "dark"), (390, "light"), (390, "dark")])
def test_a_real_browser_shows_all_of_it(browser, folder, text, width, scheme):
    (folder / "report.html").write_text(text, encoding="utf-8")
    shown = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
    said, asked = [], []
    shown.on("console", lambda message: said.append(message.text))
    shown.on("pageerror", lambda error: said.append(str(error)))
    shown.on("request", lambda request: asked.append(request.url))
    shown.goto((folder / "report.html").as_uri())
    widths = shown.evaluate("Array.from(document.images, image => image.complete ? image.naturalWidth : 0)")
    assert widths == [1200, 1200]
    assert shown.evaluate("document.documentElement.scrollWidth") <= width
    smallest = shown.evaluate(
        "Math.min(...Array.from(document.querySelectorAll('p, td, th, li, figcaption, .why'))"
        ".map(element => parseFloat(getComputedStyle(element).fontSize)))"
    )
    assert smallest >= 12.0
    assert said == []
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []
    # on paper, A4 less margins of 1 cm, nothing is cut off
    if width == 390:
        shown.set_viewport_size({"width": 718, "height": 1000})
        shown.emulate_media(media="print")
        assert shown.evaluate("document.documentElement.scrollWidth") <= 718
        assert shown.locator("table").first.evaluate("table => getComputedStyle(table).display") == "table"
    shown.close()
