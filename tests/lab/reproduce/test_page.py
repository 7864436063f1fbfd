"""The page of a reproduction: all is in it, nothing comes from elsewhere, and it fits a desk and a phone."""

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


@pytest.fixture(scope="module")
def read(text):
    return Read(text)


def test_every_tag_is_closed_and_every_id_is_one(read):
    assert read.open == []
    ids = [attributes["id"] for _, attributes, _ in read.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    for link in read.of("a"):
        assert link["href"].removeprefix("#") in ids


def test_all_pictures_are_in_the_page_with_their_captions(read, found):
    captions = [picture.caption for experiment in found.experiments for picture in experiment.pictures]
    images = read.of("img")
    assert [image["alt"] for image in images] == captions == read.said("figcaption")
    for image in images:
        content = base64.b64decode(image["src"].removeprefix("data:image/png;base64,"), validate=True)
        height, width = imread(BytesIO(content), format="png").shape[:2]
        assert (image["width"], image["height"]) == (str(width), str(height))


def test_every_row_is_there_with_paper_columns_verdict_and_reason(read, found):
    rows = [row for experiment in found.experiments for row in experiment.rows]
    heads = [text for tag, text in read.texts if tag == "th"]
    columns = [c for e in found.experiments for c in ("Figure", "Paper", *e.columns, "Verdict")]
    assert [head for head in heads if head not in columns] == [format_name(row) for row in rows]
    verdicts = [text.split(" ", 1)[1] for text in read.said("span") if re.fullmatch(r"[=+~×] .*", text)]
    assert verdicts == [row.verdict for row in rows if row.verdict]
    assert set(verdicts) == {"reproduced", "better", "missed (explained)", "missed"}
    for row in rows:
        assert not format_note(row) or format_note(row) in read.said("span")
    assert {"0.55", "(0.50 to 0.60)", "never", "10.00"} & set(read.said("span")) >= {"0.55", "(0.50 to 0.60)", "never"}


def test_verdicts_are_counted_at_the_top(read):
    assert read.said("strong") == ["1", "1", "1", "2"]


def test_what_differs_and_what_it_was_made_with_are_shown(read, found):
    shown = " ".join(text for _, text in read.texts)
    for words in (*found.differs, found.citation, found.command, "101, 102, 103", "fg-nav 0.1.0", '"sigma": 0.5'):
        assert words in shown


def test_nothing_comes_from_elsewhere(text, read):
    assert not re.search(r"https?:|@import|url\(|<script|<iframe|<object", text)
    for _, attributes, _ in read.tags:
        for name in ("src", "href", "srcset"):
            assert re.match(r"data:|#", attributes.get(name, "#"))
        assert "style" not in attributes


def test_what_is_wide_has_a_box_of_its_own(read):
    for tag, _, inside in read.tags:
        if tag == "table":
            assert inside[-1] == "div"
    boxes = [attributes for attributes in read.of("div") if attributes.get("class") == "scroll"]
    assert len(boxes) == len(read.of("table"))
    assert all(box["tabindex"] == "0" and box["role"] == "region" and box["aria-labelledby"] for box in boxes)


def test_a_picture_that_is_not_there_is_shown_in_one_sentence(found, tmp_path):
    with pytest.raises(OutputError, match=r"one\.png is not there, or is no PNG"):
        write_page(found, tmp_path)


@pytest.fixture(scope="module")
def browser():
    with open_browser() as opened:
        yield opened


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
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
    assert shown.evaluate("document.scrollingElement.scrollWidth <= window.innerWidth")
    smallest = shown.evaluate(
        "Math.min(...Array.from(document.querySelectorAll('p, td, th, li, figcaption, .why'))"
        ".map(element => parseFloat(getComputedStyle(element).fontSize)))"
    )
    assert smallest >= 12.0
    assert said == []
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []
    shown.close()


def test_on_paper_nothing_is_cut_off(browser, folder, text):
    (folder / "report.html").write_text(text, encoding="utf-8")
    shown = browser.new_page(viewport={"width": 718, "height": 1000})  # A4 less margins of 1 cm
    shown.emulate_media(media="print")
    shown.goto((folder / "report.html").as_uri())
    assert shown.evaluate("document.documentElement.scrollWidth") <= 718
    assert shown.locator("table").first.evaluate("table => getComputedStyle(table).display") == "table"
    shown.close()
