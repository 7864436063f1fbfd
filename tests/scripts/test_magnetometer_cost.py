"""The script that measures what the magnetometer costs."""

from fg_nav.lab.simulation import simulate
from tests.scripts import load_script

benchmark = load_script("benchmark_magnetometer")


def test_the_ratio_is_taken_within_a_repeat_and_its_median_counts(capsys):
    without, with_it = (1.0, 2.0, 4.0), (1.4, 3.2, 5.0)
    repeats = [
        {"walk": {benchmark.WITHOUT: one, benchmark.WITH: other}} for one, other in zip(without, with_it, strict=True)
    ]
    figures = benchmark.print_costs({"walk": simulate("demo", 1).recording}, repeats)
    assert [(one.measured, one.mark) for one in figures] == [(1.4, "ok")]
    assert "1.40 (1.25 to 1.60)" in capsys.readouterr().out


def test_one_mode_uses_the_magnetometer_and_the_other_does_not(monkeypatch):
    used = []
    monkeypatch.setattr(benchmark, "run_method", lambda walk, method: used.append((method, walk.field is not None)))
    times = benchmark.measure_modes(simulate("demo", 1).recording)
    assert list(times) == [benchmark.WITHOUT, benchmark.WITH]
    assert used == [("smoother", False), ("smoother", True)]
