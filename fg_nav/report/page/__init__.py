"""`report.html`: one self-contained page of a result.

plotly.js (its basic bundle, MIT licence, in `LICENSE-plotly.txt`) stands in the page; it is packed in the package, and
the figures are plain dictionaries, so no other package is needed. A policy in the page forbids every request, and all
texts are escaped, so neither a recording nor its name can inject code.
"""

from __future__ import annotations

import gzip
import json
from pathlib import Path

from fg_nav.report import REPORT
from fg_nav.report.charts import render_plotly
from fg_nav.report.page.content import Page
from fg_nav.text import find_version, to_json

PLOTLY = "plotly-basic-4.1.1.min.js"
_HERE = Path(__file__).parent


def write_page(folder: Path, page: Page) -> None:
    """Write the page of a result into its folder."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=FileSystemLoader(_HERE), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["json"] = lambda value: json.dumps(to_json(value), indent=1, ensure_ascii=False)
    content = {chart.name: render_plotly(chart) for section in page.sections for chart in section.charts}
    charts = json.dumps(content, separators=(",", ":"), allow_nan=False, ensure_ascii=False)
    # no character may end an element of the page
    charts = charts.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
    text = environment.get_template("report.html.j2").render(
        page=page,
        version=find_version(),
        charts=Markup(charts),
        plotly=Markup(gzip.decompress((_HERE / f"{PLOTLY}.gz").read_bytes()).decode("utf-8")),
        licence=(_HERE / "LICENSE-plotly.txt").read_text(encoding="utf-8"),
        script=Markup((_HERE / "report.js").read_text(encoding="utf-8")),
    )
    (folder / REPORT).write_text(text, encoding="utf-8")
