"""A reproduction made by hand, with all verdicts, nothing compared, and what a page must not stumble over."""

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from fg_nav.lab.reproduce.results import Experiment, Picture, Reproduction, Row, Spread, spread_of

SEEDS = (101, 102, 103)


def drawn(folder: Path, name: str) -> None:
    """A picture wider than a phone."""
    figure = Figure(figsize=(8, 2), dpi=150)
    FigureCanvasAgg(figure)
    figure.subplots().plot([0, 1], [1, 0])
    figure.savefig(folder / name)


def reproduction(folder: Path) -> Reproduction:
    """Two experiments, three columns, two pictures in the folder."""
    (folder / "pictures").mkdir(exist_ok=True)
    for name in ("one", "two"):
        drawn(folder, f"pictures/figure-{name}.png")
    never = spread_of([10.0, float("inf"), float("inf")])
    rows = (
        row("rmse", "m", "0.50", 0.5, ours=0.55),
        row("end < error & more", "m", "0.50", 0.5, ours=0.1),
        row("heading", "deg", "1.5", 1.5, ours=9.0, why='Their field is "smooth" & ours <is> not.'),
        row("landmarks", "", "1.5", 1.5, ours=9.0),
        Row("minutes until it is known", "min", "29", {"filter": never}, paper=29.0, judged="filter"),
        Row("not known", "", "", {"filter": spread_of([])}),
    )
    wide = tuple(f"a method with a long name {k}" for k in range(7))
    long = "averyverylongwordthatnobodywouldwritebutaparametermight" * 3
    second = Row(long, "m/s", "about 3", {name: spread_of([1.0, 2.0, 3.0]) for name in wide})
    return Reproduction(
        "ma2018",
        "Ma, M. et al. (2018). A title & more. Sensors.",
        SEEDS,
        (
            Experiment("M-E1", "The <first>", "As set.\n\nAnd more.", ("filter", "smoother"), rows, (_picture("one"),)),
            Experiment("M-E2", "The second", "", wide, (second,), (_picture("two"),)),
        ),
        ("Another sensor.", "Another building."),
        {"filter": {"sigma": 0.5, "name": long}},
        "fg-nav lab reproduce ma2018 --seeds 3",
        {"fg-nav": "0.1.0"},
    )


def row(quantity: str, unit: str, printed: str, paper: float, ours: float, why: str = "") -> Row:
    """Judged by the filter; less is better."""
    spread = {"filter": spread_of([0.9 * ours, ours, 1.1 * ours]), "smoother": Spread(1.0, 1.0, 1.0, 1)}
    return Row(quantity, unit, printed, spread, paper, "filter", good=-1, why=why)


def _picture(name: str) -> Picture:
    return Picture(f"pictures/figure-{name}.png", f'Figure {name}: "so & so" < that.')
