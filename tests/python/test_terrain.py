# SPDX-License-Identifier: Apache-2.0
"""Terrains: arrays and rasters in, heights out."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import mtdb
import numpy as np
import pytest

ROWS, COLUMNS = 60, 80
TRANSFORM = (500000.0, 10.0, 0.0, 4100000.0, 0.0, -10.0)


def valley() -> Any:
    """Heights in steps of 0.5, with a lake of no height."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[0:ROWS, 0:COLUMNS]
    heights = np.round(40 * np.sin(x * 0.1) + y * 0.8 + rng.random((ROWS, COLUMNS))) / 2
    heights[20:24, 30:37] = np.nan
    return heights


@pytest.fixture(scope="module")
def terrain(tmp_path_factory: pytest.TempPathFactory) -> mtdb.Object:
    db = mtdb.open(tmp_path_factory.mktemp("terrain") / "t.mtdb", create=True)
    return db.ingest_heights(valley(), name="valley", geotransform=TRANSFORM, height_step=0.5, height_units="m",
                             crs="EPSG:25832")


def same(a: Any, b: Any) -> bool:
    return bool(np.array_equal(a, b, equal_nan=True))


def test_all_samples_come_back(terrain: mtdb.Object) -> None:
    grid = terrain.heights()
    assert same(grid.heights, valley()) and same(np.asarray(grid), valley())
    assert grid.error_bound == 0
    assert grid.x[0] == 500000 and grid.x[-1] == 500000 + 10 * (COLUMNS - 1)
    assert grid.y[0] == 4100000 and grid.y[1] == 4100000 - 10
    frame = terrain.info["raster"]
    assert frame["crs"] == "EPSG:25832" and frame["height_units"] == "m"


def test_within_an_error(terrain: mtdb.Object) -> None:
    for error in (1.0, 3.0, 10.0):
        grid = terrain.heights(error=error)
        assert 0 < grid.error_bound <= error
        there = ~np.isnan(valley())
        assert np.nanmax(np.abs(grid.heights[there] - valley()[there])) <= grid.error_bound + 1e-9


def test_windows_and_spacings(terrain: mtdb.Object) -> None:
    window = [500100, 4099800, 500200, 4099900]
    part = terrain.heights(window)
    assert same(part.heights, valley()[10:21, 10:21])
    twice = terrain.heights(window, 5)
    assert twice.heights.shape == (21, 21) and same(twice.heights[::2, ::2], part.heights)
    # Between two samples of a row the surface is straight.
    assert np.allclose(twice.heights[0, 1::2], (part.heights[0, 1:] + part.heights[0, :-1]) / 2)
    assert terrain.heights(window, (10, 5)).heights.shape == (21, 11)
    assert same(terrain.heights(window, np.float32(5)).heights, twice.heights)  # type: ignore[arg-type]
    assert np.all(np.isnan(terrain.heights([0, 0, 20, 20]).heights))  # outside
    for bad in (dict(window=[1, 1, 2, 2]), dict(window=[1, 2]), dict(spacing=0), dict(error=-1),
                dict(spacing=[1, 2, 3])):
        with pytest.raises(ValueError):
            terrain.heights(**bad)


def test_points_and_profiles(terrain: mtdb.Object) -> None:
    grid = terrain.heights()
    rows, columns = np.random.default_rng(5).integers([0, 0], [ROWS, COLUMNS], (100, 2)).T
    points = np.stack([grid.x[columns], grid.y[rows]], 1)
    assert same(terrain.heights_at(points), grid.heights[rows, columns])
    assert np.isnan(terrain.heights_at([[0, 0]])[0]) and len(terrain.heights_at(np.empty((0, 2)))) == 0
    line = terrain.profile([[grid.x[2], grid.y[5]], [grid.x[12], grid.y[5]], [grid.x[12], grid.y[9]]])
    assert line.distance[0] == 0 and np.isclose(line.distance[-1], 140)
    assert np.all(np.diff(line.distance) >= 0) and line.error_bound == 0
    along = np.interp(np.arange(11) * 10.0, line.distance, line.height)
    assert np.allclose(along, grid.heights[5, 2:13])
    for bad in ([[1, 2]], [1, 2, 3], [[1, 2], [1, 2]]):
        with pytest.raises(ValueError):
            terrain.profile(bad)


def test_pictures_are_maps(terrain: mtdb.Object) -> None:
    size = (120, 90)
    drawn = terrain.render(size)
    assert np.any(drawn != terrain.render(size, colour="none"))
    assert np.array_equal(drawn, terrain.render(size, hillshade=True, colour="height"))


def test_rasters_are_files_too(tmp_path: Path) -> None:
    heights = np.arange(12.0).reshape(3, 4)

    def write(name: str, part: Any, west: int) -> Path:
        path = tmp_path / name
        path.write_text(f"ncols {part.shape[1]}\nnrows 3\nxllcenter {west}\nyllcenter 0\n"
                        f"cellsize 1\n" + "\n".join(" ".join(map(str, row)) for row in part))
        return path
    west, east = write("w.asc", heights[:, :3], 0), write("e.asc", heights[:, 2:], 2)
    with mtdb.open(tmp_path / "t.mtdb", create=True) as db:
        assert same(db.ingest([west, east], name="both").heights().heights, heights)
        assert same(db.ingest(west, name="west").heights().heights, heights[:, :3])
        plain = db.ingest_heights(heights, name="plain").heights()
        assert same(plain.heights, heights) and list(plain.y) == [0, -1, -2]
        with pytest.raises(ValueError, match="height_step"):
            db.ingest(west, name="x", bits=16)
        tenths = db.ingest_heights(heights + 0.3, name="tenths")
        assert tenths.rounding_error < 1e-12
        assert np.abs(tenths.heights().heights - heights - 0.3).max() < 1e-9
        wild = db.ingest_heights(heights / 7 + np.sin(heights), name="wild")
        assert 0 < wild.rounding_error <= 1e-3 * 12
        with pytest.raises(mtdb.MtdbError) as refused:
            db.ingest_heights(np.array([[0.5, 1e300], [0.25, 1]]), name="x")
        assert "--" not in str(refused.value)
        with pytest.raises(ValueError):
            db.ingest_heights(heights[0], name="x")
        with pytest.raises(ValueError, match="terrain"):
            db.ingest(np.eye(3), [[0, 1, 2]], name="mesh").heights()
        with pytest.raises(ValueError, match="terrain"):
            db["mesh"].profile([[0, 0], [1, 1]])
        assert "x" not in db
        heights[1, 1] = np.nan
        closed = db.ingest_heights(heights, name="closed", fill=1, height_step=1).heights().heights
        assert closed[1, 1] == 5 and same(np.delete(closed, 5), np.delete(heights, 5))
        rows, columns = np.mgrid[0:5, 0:5]
        field = np.stack([columns, rows, columns * rows], -1).reshape(-1, 3).astype(float)
        faces = [[5 * r + c, 5 * r + c + 1, 5 * r + c + 5] for r in range(4) for c in range(4)]
        mesh = db.ingest(field, faces, name="field", terrain=True)
        assert mesh.heights_at([[1.25, 2.25]])[0] == pytest.approx(1.25 * 2 + 0.25)
        with pytest.raises(mtdb.BadInput, match="upright"):
            db.ingest(field[:, [0, 2, 1]], faces, name="x", terrain=True)
        with pytest.raises(ValueError, match="fill"):
            db.ingest_heights(heights, name="x", fill=-1)
        with pytest.raises(ValueError, match="fill"):
            db.ingest(np.eye(3), [[0, 1, 2]], name="x", fill=1)
