# SPDX-License-Identifier: Apache-2.0
"""Stores from Python: ingest, mapping, changes, errors."""
from __future__ import annotations

import gzip
import http.server
import os
import pickle
import threading
from pathlib import Path
from typing import Any, Iterator

import mtdb
import numpy as np
import pytest
from conftest import hills


def chunks(vertices: Any, faces: Any, attributes: Any, size: int) -> Iterator[Any]:
    """Faces in advance of their vertices, too."""
    for at in range(0, max(len(vertices), len(faces)), size):
        part = slice(at, at + size)
        yield vertices[part], faces[part], {n: a[part] for n, a in attributes.items()}


def test_chunks_arrays_meshes_and_files_give_the_same_object(tmp_path: Path) -> None:
    vertices, faces, attributes = hills(60)
    db = mtdb.open(tmp_path / "a.mtdb", create=True)
    digest = db.ingest(vertices, faces, name="arrays", attributes=attributes).digest
    assert db.ingest(chunks(vertices, faces, attributes, 500), name="chunks").digest == digest
    mesh = mtdb.Mesh(vertices, faces, attributes)
    assert db.ingest(mesh, name="mesh").digest == digest
    mesh.save(tmp_path / "mesh.ply")
    assert db.ingest(tmp_path / "mesh.ply", name="file").digest == digest
    with gzip.open(tmp_path / "mesh.ply.gz", "wb") as packed:
        packed.write((tmp_path / "mesh.ply").read_bytes())
    assert db.ingest(str(tmp_path / "mesh.ply.gz"), name="gzip").digest == digest
    for kind in (np.int32, np.uint32, np.int64, np.uint16):
        assert db.ingest(vertices, faces.astype(kind), name="x", attributes=attributes,
                         replace=True).digest == digest
    single = vertices.astype(np.float32)
    assert db.ingest(single, faces, name="x", attributes=attributes, replace=True).digest == digest
    strided = np.asfortranarray(vertices)[:, ::-1][:, ::-1]
    assert db.ingest(strided, np.asfortranarray(faces), name="x", attributes=attributes,
                     replace=True).digest == digest


def test_up_and_units_are_kept(tmp_path: Path) -> None:
    vertices, faces, _ = hills(20)
    db = mtdb.open(tmp_path / "a.mtdb", create=True)
    found = db.ingest(vertices, faces, name="found")
    assert found.up is not None and abs(np.linalg.norm(found.up) - 1) < 1e-9
    assert found.up[2] > 0.7 and found.units == ""
    said = db.ingest(vertices, faces, name="said", up="-y", units="mm")
    assert said.up is not None and said.up.tolist() == [0, -1, 0] and said.units == "mm"
    assert said.info["up_given"] is True
    turned = db.ingest(vertices, faces, name="turned", up=(3, 0, 4))
    assert turned.up is not None and np.allclose(turned.up, [0.6, 0, 0.8])
    wrong: Any
    for wrong in ("w", "--x", (0, 0, 0), (1, 2)):
        with pytest.raises(mtdb.InvalidArgument, match="up"):
            db.ingest(vertices, faces, name="no", up=wrong)
    with pytest.raises(mtdb.InvalidArgument, match="units"):
        db.ingest(vertices, faces, name="no", units="league")


def test_what_is_stored_comes_back(tmp_path: Path) -> None:
    vertices, faces, attributes = hills(40)
    db = mtdb.open(tmp_path / "a.mtdb", create=True)
    mesh = db.ingest(vertices, faces, name="a", attributes=attributes, lossless=True).extract()
    assert len(mesh.faces) == len(faces) and mesh.error_bound == 0
    order = np.lexsort(vertices.T)
    found = np.lexsort(np.asarray(mesh.vertices).T)
    np.testing.assert_array_equal(mesh.vertices[found], vertices[order])
    for name, values in attributes.items():
        np.testing.assert_array_equal(mesh.attributes[name][found], values[order])
    assert mesh.colours is not None and mesh.colours.dtype == np.uint8
    np.testing.assert_array_equal(mesh.colours[found][:, 1], attributes["green"][order])


def test_a_database_is_a_mapping(tmp_path: Path) -> None:
    vertices, faces, _ = hills(20)
    path = tmp_path / "a.mtdb"
    with pytest.raises(mtdb.NotFound):
        mtdb.open(path)
    db = mtdb.open(path, create=True)
    assert len(db) == 0 and list(db) == []
    db.ingest(vertices, faces, name="b")
    db.ingest(vertices, faces, name="a")
    assert list(db) == ["a", "b"] and "a" in db and "c" not in db and 7 not in db
    assert {name: o.triangles for name, o in db.items()} == {"a": len(faces), "b": len(faces)}
    assert db["a"] is db["a"]
    with pytest.raises(KeyError) as error:
        db["c"]
    assert "no object 'c'" in str(error.value) and error.value.code == mtdb.Code.NOT_FOUND
    with pytest.raises(mtdb.AlreadyExists):
        db.ingest(vertices, faces, name="a")
    db.rename("a", "c")
    del db["b"]
    assert list(db) == ["c"] and db.verify("global") == {}
    with pytest.raises(mtdb.NotFound):
        del db["b"]
    copy = db.copy(tmp_path / "copy.mtdb")
    assert copy["c"].digest == db["c"].digest
    copy.copy_from(db["c"], "d")
    assert list(copy) == ["c", "d"]
    packed = tmp_path / "p.mtdbp"
    assert copy.pack(packed, ["d"]) == packed.stat().st_size
    assert mtdb.open(packed)["d"].digest == db["c"].digest
    unpacked = mtdb.open(packed).unpack(tmp_path / "u.mtdb")
    assert unpacked["d"].digest == db["c"].digest
    with pytest.raises(mtdb.AlreadyExists):
        mtdb.open(packed).unpack(tmp_path / "u.mtdb", ["d"])
    mtdb.open(packed).unpack(tmp_path / "u.mtdb", replace=True)
    before, after = db.compact()
    assert after < before == pytest.approx(before)
    assert db["c"].triangles == len(faces)
    db.close()
    db.close()
    with pytest.raises(mtdb.InvalidArgument, match="closed"):
        len(db)
    assert "closed" in repr(db)


def test_what_makes_no_sense_is_refused(tmp_path: Path) -> None:
    vertices, faces, attributes = hills(12)
    db = mtdb.open(tmp_path / "a.mtdb", create=True)
    bad = faces.copy()
    bad[3, 1] = len(vertices)
    negative = faces.copy()
    negative[0, 0] = -1
    not_finite = vertices.copy()
    not_finite[5, 1] = np.nan
    for call in (
        lambda: db.ingest(vertices, bad, name="x"),
        lambda: db.ingest(vertices, negative, name="x"),
        lambda: db.ingest(not_finite, faces, name="x"),
        lambda: db.ingest(vertices, faces[:0], name="x"),
        lambda: db.ingest(vertices[:, :2], faces, name="x"),
        lambda: db.ingest(vertices, faces.astype(float), name="x"),
        lambda: db.ingest(vertices, faces, name=""),
        lambda: db.ingest(vertices, faces, name="x", bits=99),
        lambda: db.ingest(vertices, faces, name="x", bits=-1),
        lambda: db.ingest(vertices, faces, name="x", lossless=True, bits=12),
        lambda: db.ingest(vertices, faces, name="x", memory_bytes=5),
        lambda: db.ingest(vertices, faces, name="x", attributes={"a": np.zeros(3)}),
        lambda: db.ingest(vertices, faces, name="x", attributes={"a": np.zeros(144, complex)}),
        lambda: db.ingest(vertices, faces, name="x", attribute_steps={"none": 0.5}),
        lambda: db.ingest(iter([]), name="x"),
        lambda: db.ingest([(vertices,)], name="x"),
        lambda: mtdb.Mesh(vertices, faces.ravel()),
        lambda: mtdb.Mesh(vertices, bad).save(tmp_path / "x.ply"),
    ):
        with pytest.raises(ValueError):
            call()
    with pytest.raises(mtdb.NotFound):
        db.ingest("none.ply", name="x")
    with pytest.raises(mtdb.Unsupported):
        mtdb.Mesh(vertices, faces).save(tmp_path / "x.zip")
    assert len(db) == 0


def test_what_c_would_cut_is_refused(tmp_path: Path) -> None:
    """Zero bytes in names and paths, and numbers that do not fit."""
    vertices, faces, _ = hills(12)
    heat = np.zeros(len(vertices), np.float32)
    db = mtdb.open(tmp_path / "a.mtdb", create=True)
    db.ingest(vertices, faces, name="a")
    mesh = db["a"].extract()
    for call in (
        lambda: mtdb.open(f"{tmp_path}/a.mtdb\0b"),
        lambda: db.ingest(vertices, faces, name="b\0c"),
        lambda: db.ingest(vertices, faces, name="b", attributes={"a\0b": heat}),
        lambda: db.ingest(vertices, faces, name="b", tmp_directory=f"{tmp_path}\0b"),
        lambda: db.ingest(vertices, faces, name="b", attribute_steps={"a\0b": 1}),
        lambda: db.__delitem__("a\0b"),
        lambda: db.rename("a", "b\0c"),
        lambda: db.pack(tmp_path / "a.mtdbp", ["a\0b"]),
        lambda: mesh.save(f"{tmp_path}/x.ply\0.obj"),
        lambda: db.ingest(vertices, faces, name="b", memory_bytes=-1),
        lambda: db.ingest(vertices, faces, name="b", threads=2**32 + 1),
        lambda: db.open_object("a", cache_bytes=-1),
        lambda: db.open_object("a", cache_bytes=2**64 + 1),
        lambda: mesh.render((2**32 + 8, 8)),
        lambda: mtdb.Mesh(vertices, faces.astype(np.int64) + 2**32),
        lambda: mtdb.Mesh(vertices, faces.astype(np.uint64) + 2**63),
        lambda: db.ingest(vertices, faces.astype(np.uint64) + 2**63, name="b"),
    ):
        with pytest.raises(ValueError):
            call()
    assert list(db) == ["a"]


def test_a_mesh_is_what_its_arrays_are(tmp_path: Path) -> None:
    vertices, faces, attributes = hills(12)
    db = mtdb.open(tmp_path / "a.mtdb", create=True)
    db.ingest(vertices, faces, name="a", attributes=attributes)
    for mesh in (db["a"].extract(), db["a"].extract(dtype=np.float32, origin=(1, 2, 3))):
        bounds = mesh.bounds
        mesh.vertices = mesh.vertices + np.float32(8)
        mesh.save(tmp_path / "x.ply")
        assert np.allclose(mtdb.read_mesh(tmp_path / "x.ply").bounds, bounds + 8)
        mesh.faces = mesh.faces[::2]
        mesh.attributes = {"heat": mesh.attributes["heat"] * 2}
        assert mesh.colours is None
        mesh.save(tmp_path / "x.ply")
        saved = mtdb.read_mesh(tmp_path / "x.ply")
        assert (saved.faces == mesh.faces).all() and list(saved.attributes) == ["heat"]
        assert (saved.attributes["heat"] == mesh.attributes["heat"]).all()
    for name, wrong in (
        ("vertices", vertices[:, :2]),
        ("vertices", vertices.ravel()),
        ("vertices", vertices[:5]),
        ("vertices", vertices + 1j),
        ("vertices", vertices.astype(str)),
        ("faces", faces[:, :2]),
        ("faces", faces + 0.5),
        ("faces", faces.astype(np.int64) + 2**32),
    ):
        mesh = db["a"].extract()
        setattr(mesh, name, wrong)
        for use in (lambda: mesh.save(tmp_path / "x.ply"), lambda: mesh.render((32, 32)),
                    lambda: db.ingest(mesh, name="b")):
            with pytest.raises(ValueError):
                use()
    assert list(db) == ["a"]


def test_a_textured_mesh_has_its_corners_and_images(tmp_path: Path) -> None:
    n = 9
    lines = ["mtllib a.mtl"]
    at = [(x, y) for y in range(n) for x in range(n)]
    lines += [f"v {x} {y} {0.1 * x * y}" for x, y in at] + [f"vt {x / 8} {y / 16}" for x, y in at]
    for page in range(2):
        lines.append(f"usemtl m{page}")
        for y in range(n - 1):
            for x in range(4 * page, 4 * page + 4):
                a, b, c, d = (1 + (y + j) * n + x + i for j, i in ((0, 0), (0, 1), (1, 1), (1, 0)))
                lines += [f"f {a}/{a} {b}/{b} {c}/{c}", f"f {a}/{a} {c}/{c} {d}/{d}"]
    (tmp_path / "a.obj").write_text("\n".join(lines) + "\n")
    (tmp_path / "a.mtl").write_text("newmtl m0\nmap_Kd a.jpg\nnewmtl m1\nmap_Kd b.jpg\n")
    images = [b"\xff\xd8\xff\xe0 no image" * 30000, b"\xff\xd8\xff another"]
    for name, image in zip(("a.jpg", "b.jpg"), images):
        (tmp_path / name).write_bytes(image)
    db = mtdb.open(tmp_path / "a.mtdb", create=True)
    db.ingest(tmp_path / "a.obj", name="a")
    pages = db["a"].info["texture"]["pages"]
    assert [page["name"] for page in pages] == ["a.jpg", "b.jpg"]
    for i, image in enumerate(images):
        assert db["a"].read_page(i) == image
    with pytest.raises(mtdb.NotFound, match="no page 2"):
        db["a"].read_page(2)
    for mesh in (db["a"].extract(), db["a"].extract(dtype=np.float32)):
        assert mesh.corners is not None and mesh.pages is not None
        assert mesh.corners.shape == (128, 3, 2) and mesh.corners.dtype == np.float32
        expected = (mesh.vertices + mesh.origin)[mesh.faces][:, :, :2] / [8, 16]
        assert np.allclose(mesh.corners, expected, atol=1e-4)
        assert (mesh.pages == (mesh.corners[:, :, 0].mean(axis=1) > 0.5)).all()
        assert not mesh.corners.flags.writeable
        again = pickle.loads(pickle.dumps(mesh))
        assert (again.corners == mesh.corners).all() and (again.pages == mesh.pages).all()
    vertices, faces, _ = hills(5)
    db.ingest(vertices, faces, name="plain")
    assert db["plain"].extract().corners is None and mtdb.Mesh(vertices, faces).pages is None
    with pytest.raises(mtdb.NotFound, match="has 0"):
        db["plain"].read_page(0)


def test_chunks_must_agree_and_their_errors_arrive(tmp_path: Path) -> None:
    vertices, faces, attributes = hills(12)
    db = mtdb.open(tmp_path / "a.mtdb", create=True)

    def failing() -> Iterator[Any]:
        yield vertices, faces
        raise RuntimeError("the scanner fell over")

    with pytest.raises(RuntimeError, match="fell over"):
        db.ingest(failing(), name="x")
    with pytest.raises(mtdb.InvalidArgument, match="attributes"):
        db.ingest([(vertices, faces, attributes), (vertices, faces)], name="x")
    assert len(db) == 0


def test_progress_is_told_and_stops(tmp_path: Path) -> None:
    vertices, faces, _ = hills(60)
    db = mtdb.open(tmp_path / "a.mtdb", create=True)
    told: list[tuple[str, float]] = []
    db.ingest(vertices, faces, name="a", progress=lambda stage, done: told.append((stage, done)))
    assert told and told[-1][1] == 1.0 and {"read", "round 1"} <= {s for s, _ in told}
    with pytest.raises(mtdb.Cancelled):
        db.ingest(vertices, faces, name="b", progress=lambda stage, done: False)

    def fails(stage: str, done: float) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        db.ingest(vertices, faces, name="b", progress=fails)
    db.ingest(vertices, faces, name="b", progress=True)  # tqdm, where it is installed
    assert list(db) == ["a", "b"]


def test_errors_have_codes_and_families(store: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.mtdb"
    data = bytearray(store.read_bytes())
    data[:8192] = b"x" * 8192
    damaged.write_bytes(data)
    with pytest.raises(mtdb.MtdbError) as error:
        mtdb.open(damaged)
    assert error.value.code in (mtdb.Code.CORRUPT, mtdb.Code.UNSUPPORTED, mtdb.Code.BAD_INPUT)
    assert "damaged.mtdb" in str(error.value)
    again = pickle.loads(pickle.dumps(error.value))
    assert type(again) is type(error.value) and str(again) == str(error.value)


def test_nothing_replaces_a_store(store: Path, tmp_path: Path) -> None:
    path = tmp_path / "s.mtdb"
    path.write_bytes(store.read_bytes())
    link = tmp_path / "link.ply"
    link.symlink_to(path)
    before = path.read_bytes()
    db = mtdb.open(path)
    mesh = db["small"].extract()
    for write in (
        lambda: db.pack(path, ["small"]),
        lambda: db.pack(link),
        lambda: mesh.save(link),
        lambda: db["small"].extract_to(link),
        lambda: db.ingest(mesh, name="new", journal_path=str(path)),
    ):
        with pytest.raises(mtdb.MtdbError) as error:
            write()
        assert error.value.code == mtdb.Code.ALREADY_EXISTS
    assert sorted(mtdb.open(path)) == sorted(mtdb.open(store))
    assert path.read_bytes() == before or mtdb.open(path).verify("fast")


def test_errors_and_names_show_no_passwords(tmp_path: Path) -> None:
    for url in ("http://u:S3cr3t@127.0.0.1:1/x", "s3://b/../x?X-Amz-Signature=S3cr3t"):
        with pytest.raises(mtdb.MtdbError) as error:
            mtdb.open(url)
        assert "S3cr3t" not in str(error.value)


def test_temporary_files_are_limited(tmp_path: Path) -> None:
    mesh = tmp_path / "a.obj.gz"
    lines = "".join(f"v {i} {i % 7} {i % 11}\n" for i in range(200000))
    with gzip.open(mesh, "wt") as packed:
        packed.write(lines + "f 1 2 3\n")
    db = mtdb.open(tmp_path / "s.mtdb", create=True)
    with pytest.raises(mtdb.MtdbError) as error:
        db.ingest(mesh, name="a", max_tmp_bytes=1 << 20)
    assert error.value.code == mtdb.Code.BUDGET_EXCEEDED and "max_tmp" in str(error.value)
    assert "--" not in str(error.value)
    db.ingest(mesh, name="a", max_tmp_bytes=1 << 30)


def test_verify_finds_what_is_damaged(store: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.mtdb"
    data = bytearray(store.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 4096] = os.urandom(4096)
    damaged.write_bytes(data)
    try:
        db = mtdb.open(damaged)
        found = [f for name in db for f in db[name].verify("full")]
        assert found
    except mtdb.Corrupt:
        pass


class RangeServer(http.server.BaseHTTPRequestHandler):
    """A web server that knows ranges, as a packed file needs it."""

    data = b""

    def do_GET(self) -> None:
        first, last = 0, len(self.data) - 1
        asked = self.headers.get("Range")
        if asked:
            first, last = (int(n) for n in asked.removeprefix("bytes=").split("-"))
            last = min(last, len(self.data) - 1)
        body = self.data[first : last + 1]
        self.send_response(206 if asked else 200)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("ETag", '"one"')
        if asked:
            self.send_header("Content-Range", f"bytes {first}-{last}/{len(self.data)}")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        pass


def test_a_packed_file_by_its_url(store: Path, tmp_path: Path) -> None:
    db = mtdb.open(store)
    db.pack(tmp_path / "a.mtdbp")
    RangeServer.data = (tmp_path / "a.mtdbp").read_bytes()
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), RangeServer)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        remote = mtdb.open(f"http://127.0.0.1:{server.server_address[1]}/a.mtdbp")
        assert list(remote) == ["hills", "small"]
        np.testing.assert_array_equal(
            remote["hills"].extract(error=0.1).faces, db["hills"].extract(error=0.1).faces
        )
        kept = mtdb.open(remote.path, cache_directory=tmp_path / "kept", cache_directory_bytes=1 << 26)
        kept["hills"].extract()
        assert list((tmp_path / "kept").iterdir())
        kept["hills"].verify("full")
        # Whoever opens without a folder keeps nothing, and finds nothing there.
        assert mtdb.open(remote.path)["small"].extract().faces.size
        with pytest.raises(mtdb.IoError):
            mtdb.open(remote.path, cache_directory=tmp_path / "a.mtdbp")
        copy = mtdb.open(tmp_path / "copy.mtdb", create=True)
        assert copy.copy_from(remote["small"]).digest == db["small"].digest
        with pytest.raises(mtdb.MtdbError):
            del remote["small"]
    except mtdb.Unsupported as error:
        pytest.skip(f"mtdb was built without libcurl: {error}")
    finally:
        server.shutdown()
        server.server_close()


def test_a_saved_mesh_tells_what_the_file_has(tmp_path):
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float) + [431234.567, 4812345.678, 0]
    normals = {name: np.array([0, 0, 1], float) for name in ("nx", "ny", "nz")}
    mesh = mtdb.Mesh(vertices, [[0, 1, 2]], {**normals, "two words": np.arange(3, dtype=np.int32)})
    stl = mesh.save(tmp_path / "a.stl")
    assert stl.origin is not None and 0 < stl < 1e-6
    assert stl.not_written == ["nx, ny, nz (float64)", "two words (int32)"]
    assert mesh.save(tmp_path / "a.off").not_written == stl.not_written
    assert mesh.save(tmp_path / "a.off", normals=True).not_written == ["two words (int32)"]
    assert (tmp_path / "a.off").read_text().startswith("NOFF\n")
    ply = mesh.save(tmp_path / "a.ply", double_positions=True)
    assert ply == 0 and ply.positions == "float64" and ply.origin is None
    assert ply.notes == ["attribute 'two words' is named 'two_words' in the file"]
    with pytest.raises(mtdb.InvalidArgument, match="float64"):
        mesh.save(tmp_path / "b.stl", double_positions=True)
    for name in ("x", "a\nproperty float b", ""):
        with pytest.raises(mtdb.InvalidArgument):
            mtdb.Mesh(vertices, [[0, 1, 2]], {name: np.arange(3)}).save(tmp_path / "b.ply")
        with pytest.raises(mtdb.MtdbError):
            mtdb.open(tmp_path / "s.mtdb", create=True).ingest(
                vertices, [[0, 1, 2]], name="s", attributes={name: np.arange(3)})
