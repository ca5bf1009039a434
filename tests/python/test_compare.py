# SPDX-License-Identifier: Apache-2.0
"""Comparisons from Python: verdicts, intervals, places, and who asks."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import mtdb
import numpy as np
import pytest
from conftest import hills


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A hilly square, and one with a peak that is 2 higher."""
    vertices, faces, _ = hills(60)
    path: Path = tmp_path_factory.mktemp("pair") / "a.mtdb"
    with mtdb.open(path, create=True) as db:
        db.ingest(vertices, faces, name="before")
        raised = vertices.copy()
        raised[60 * 30 + 20, 2] += 2
        db.ingest(raised, faces, name="after")
        yield db["before"], db["after"]


def test_a_tolerance_is_decided_and_the_place_is_told(pair: Any) -> None:
    before, after = pair
    found = mtdb.compare(before, after, tolerance=1.0)
    assert found.verdict == "exceeds" and not found.identical and not found.out_of_time
    assert found.b_to_a is not None and found.a_to_b is not None
    (place,) = found.b_to_a.places
    peak = np.array([20 * 0.5, 30 * 0.5])
    assert (place.box[0, :2] < peak).all() and (peak < place.box[1, :2]).all()
    assert 1.0 < place.low <= 2 <= place.high + 0.2 and place.verdict == "exceeds"
    assert np.linalg.norm(place.point[:2] - peak) < 1
    assert mtdb.compare(before, after, tolerance=2.1).verdict == "within"


def test_intervals_are_as_narrow_as_asked_and_hold_the_distance(pair: Any) -> None:
    before, after = pair
    found = mtdb.compare(before, after, width=0.01, as_stored=True)
    assert found.high - found.low <= 0.01
    assert found.a_to_b is not None and found.b_to_a is not None
    assert found.low == max(found.a_to_b.low, found.b_to_a.low)
    one = mtdb.compare(before, after, asks="a", width=0.01)
    assert one.b_to_a is None and one.a_to_b is not None


def test_regions_transforms_and_time(pair: Any) -> None:
    before, after = pair
    away = mtdb.compare(before, after, tolerance=0.1, box=[[0, 0, -99], [5, 9, 99]])
    assert away.verdict == "within"
    matrix = np.eye(4)
    matrix[2, 3] = 50
    moved = mtdb.compare(before, before, transform=matrix, tolerance=1)
    assert moved.verdict == "exceeds" and moved.low > 30
    assert mtdb.compare(before, before).identical
    none = mtdb.compare(before, after, tolerance=1, max_milliseconds=0)
    assert none.verdict == "undecided" and none.out_of_time


def test_what_means_nothing_is_refused(pair: Any) -> None:
    before, after = pair
    for wrong in ({"tolerance": -1}, {"width": -1}, {"reach": -1}, {"asks": "c"},
                  {"transform": np.eye(3)}, {"transform": np.zeros((4, 4))}):
        with pytest.raises(mtdb.InvalidArgument):
            mtdb.compare(before, after, **wrong)


def test_heights_of_terrains_and_volumes(tmp_path: Path) -> None:
    ramp = np.add.outer(np.arange(20.0), np.arange(30.0))
    with mtdb.open(tmp_path / "t.mtdb", create=True) as db:
        db.ingest_heights(ramp, name="may")
        raised = ramp.copy()
        raised[10, 12] += 3
        raised[4, 5] -= 2
        db.ingest_heights(raised, name="june")
        found = mtdb.compare_heights(db["may"], db["june"], width=0)
        assert found.rise.low == pytest.approx(3) and found.rise.high == pytest.approx(3)
        assert found.rise.point is not None
        assert found.rise.point == pytest.approx([12, -10, 25])
        assert found.fall.high == pytest.approx(2)
        # Pyramids over six triangles of half a cell.
        assert found.fill_volume == pytest.approx((3, 3))
        assert found.cut_volume == pytest.approx((2, 2))
        assert found.net_volume == pytest.approx((1, 1), abs=1e-6)
        assert found.area_both == pytest.approx((19 * 29, 19 * 29))
        assert found.metres_of_unit == (1, 1) and not found.out_of_time
        part = mtdb.compare_heights(db["may"], db["june"], width=0, window=[10, -19, 29, 0])
        assert part.cut_volume[1] < 1e-6 and part.fill_volume == pytest.approx((3, 3))
        assert mtdb.compare_heights(db["may"], db["june"], tolerance=3.1).verdict == "within"
        assert mtdb.compare_heights(db["may"], db["june"], tolerance=2.9).verdict == "exceeds"
        assert mtdb.compare_heights(db["may"], db["may"]).identical
        for wrong in ({"tolerance": -1}, {"window": [0, 0, 1]}, {"window": [1, 1, 0, 0]}):
            with pytest.raises(mtdb.InvalidArgument):
                mtdb.compare_heights(db["may"], db["june"], **wrong)
