import pytest

from fg_nav.walk import Walk
from tests.report import walks


@pytest.fixture(scope="session")
def session() -> Walk:
    return walks.walk()
