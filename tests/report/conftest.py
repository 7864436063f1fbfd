import pytest

from fg_nav.session import Session
from tests.report import walks


@pytest.fixture(scope="session")
def session() -> Session:
    return walks.walk()
