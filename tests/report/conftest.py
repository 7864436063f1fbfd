import pytest

from fg_nav.walk import Walk
from tests.report import walks


@pytest.fixture(scope="session")
def walk() -> Walk:
    return walks.walk()
