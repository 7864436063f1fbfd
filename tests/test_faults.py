from collections import Counter

from tests import faults

FEWEST = 2  # Faults of a package.


def test_each_fault_has_its_one_place_in_the_code_and_is_python() -> None:
    of_equations = faults.read_faults(faults.EQUATIONS)
    assert list(faults.find_problems([*faults.read_faults(), *of_equations])) == []
    assert list(faults.find_rows_without_one(of_equations)) == []


def test_each_package_has_faults() -> None:
    count = Counter(fault.package for fault in faults.read_faults())
    packages = {path.parent.name for path in (faults.ROOT / "fg_nav").glob("*/__init__.py")} | {"fg_nav"}
    assert [name for name in packages if count[name] < FEWEST] == []
