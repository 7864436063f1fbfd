"""What holds of every result that is stored."""

import json
from dataclasses import replace

from fg_nav.lab.store.results import read_result, write_result


def check_that_it_alone_is_read(folder, result):
    """Store a result and return it as read; by other settings, in another form or damaged it is none."""
    key, settings = result.key, result.settings
    write_result(folder, result)
    found = read_result(folder, key, settings)
    assert read_result(folder, key, {**settings, "method": {"sigma": 0.2, "names": ["a", "b"]}}) is None
    assert read_result(folder, replace(key, walk="102"), settings) is None
    path = folder / key.file
    whole = path.read_text()
    for broken in (whole[: len(whole) // 2], "[]", "{}", json.dumps({**json.loads(whole), "form": 0})):
        path.write_text(broken)
        assert read_result(folder, key, settings) is None
    return found
