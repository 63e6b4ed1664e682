"""Results of runs, compared to the last bit."""

from __future__ import annotations

import dynstiction as ds


def assert_same(a: ds.Result, b: ds.Result) -> None:
    """Columns and events."""
    assert set(a.columns) == set(b.columns)
    for name in a:
        assert a[name].tobytes() == b[name].tobytes(), name
    assert a.events.tobytes() == b.events.tobytes()
