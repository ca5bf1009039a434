# SPDX-License-Identifier: Apache-2.0
"""Queries from Python: the same answers as the command line's, arrays, their lives, threads."""
from __future__ import annotations

import gc
import json
import os
import resource
import subprocess
import sys
import threading
import weakref
from pathlib import Path
from typing import Any

import mtdb
import numpy as np
import pytest
from conftest import hills


def random_query(rng: np.random.Generator, bounds: Any) -> dict[str, Any]:
    low, high = bounds
    point = (low + (high - low) * rng.random(3)).tolist()
    size = float((high - low).max())
    region = [
        None,
        {"sphere": {"centre": point, "radius": size * float(rng.random()) / 3}},
        {"box": {"min": point, "max": (np.array(point) + size / 4).tolist()}},
        {"tube": {"line": [low.tolist(), point, high.tolist()], "radius": size / 20}},
        {"outside": {"half_space": {"point": point, "normal": rng.standard_normal(3).tolist()}}},
    ][rng.integers(5)]
    threshold = [
        "full",
        "coarsest",
        0.3 * float(rng.random()),
        {"relative": 0.01 * float(rng.random())},
        {"linear": {"point": point, "base": 0.01, "slope": 0.02}},
    ][rng.integers(5)]
    query: dict[str, Any] = {"threshold": threshold}
    if region is not None:
        query["region"] = region
        query["clip"] = bool(rng.integers(2))
    if rng.integers(3) == 0:
        query["max_triangles"] = int(rng.integers(500, 20000))
    return query


def test_answers_are_those_of_the_command_line(
    store: Path, db: mtdb.Database, tmp_path: Path, mtdb_command: str
) -> None:
    """The command line is C++: the same vertices, faces and attributes, in the same order."""
    rng = np.random.default_rng(5)
    hill = db["hills"]
    for _ in range(int(os.environ.get("MTDB_QUERIES", "12"))):
        query = random_query(rng, hill.bounds)
        (tmp_path / "q.json").write_text(json.dumps(query))
        told = subprocess.run(
            [mtdb_command, "extract", store, tmp_path / "out.ply", "--query", tmp_path / "q.json",
             "--name", "hills", "--json"],
            check=True, capture_output=True,
        )
        mesh = hill.extract(query)
        report = json.loads(told.stdout)
        assert report["triangles"] == len(mesh.faces), query
        if len(mesh.faces) == 0:
            continue
        expected = mtdb.read_mesh(tmp_path / "out.ply")
        np.testing.assert_array_equal(expected.faces, mesh.faces)
        np.testing.assert_array_equal(expected.vertices, mesh.vertices)
        for name in mesh.attributes:
            np.testing.assert_array_equal(expected.attributes[name], mesh.attributes[name])
        assert report["error_bound"] == mesh.error_bound


@pytest.mark.filterwarnings("ignore::mtdb.RegionMissed")
def test_arguments_are_queries(db: mtdb.Database) -> None:
    hill = db["hills"]
    camera = {"eye": [30, -20, 30], "target": [30, 30, 0], "fov": 40, "viewport": [640, 480]}
    same = [
        (dict(error=0.1), {"threshold": 0.1}),
        (dict(relative=0.01), {"threshold": {"relative": 0.01}}),
        (dict(box=[[0, 0, -9], [9, 9, 9]], clip=True),
         {"region": {"box": {"min": [0, 0, -9], "max": [9, 9, 9]}}, "clip": True}),
        (dict(sphere=np.array([9, 9, 0, 5.0]), error=0.05),
         {"region": {"sphere": {"centre": [9, 9, 0], "radius": 5}}, "threshold": 0.05}),
        (dict(camera=camera),
         {"region": {"frustum": camera}, "threshold": {"screen": {"camera": camera, "pixels": 1}}}),
        (dict(camera=camera, error=0.5), {"region": {"frustum": camera}, "threshold": 0.5}),
        (dict(max_triangles=np.int64(3000)), {"max_triangles": 3000}),
        (dict(region={"point": np.array([5.0, 5.0, 0.0])}, threshold="full"),
         {"region": {"point": [5, 5, 0]}, "threshold": "full"}),
    ]
    for arguments, query in same:
        one, two = hill.extract(**arguments), hill.extract(query)  # type: ignore[arg-type]
        np.testing.assert_array_equal(one.faces, two.faces)
        three = hill.extract(json.dumps(query))
        np.testing.assert_array_equal(one.faces, three.faces)
    for wrong in (
        dict(box=[1, 2, 3]), dict(sphere=[1]), dict(error=-1.0), dict(pixels=1.0),
        dict(dtype=np.int32), dict(origin=[0, 0, 0]), dict(query={"nothing": 1}),
        dict(query={}, error=1.0), dict(threshold={"linear": {}}), dict(query="{"),
    ):
        with pytest.raises(ValueError):
            hill.extract(**wrong)  # type: ignore[arg-type]
    with pytest.raises(TypeError):
        hill.extract(region={"point": object()})  # type: ignore[dict-item]
    mesh = hill.extract(max_triangles=3000, normals=True)
    assert len(mesh.faces) <= 3000 and mesh.stats is not None and mesh.stats.limit == "triangles"
    assert mesh.shortfall is not None and mesh.shortfall.excess > 0
    assert mesh.normals is not None and mesh.normals.shape == mesh.vertices.shape
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-5)


def test_what_is_in_memory_is_enough_for_available_only(store: Path) -> None:
    with mtdb.open(store) as db:
        cold = db.open_object("hills")
        limits, triangles = [], [0]
        while not limits or limits[-1] == "missing":
            try:
                mesh = cold.extract({"available_only": True})
            except mtdb.NotYet:
                continue
            assert mesh.stats is not None
            limits.append(mesh.stats.limit)
            triangles.append(len(mesh.faces))
        # The first answers have clusters missing, the last one has them all.
        assert limits[0] == "missing"
        assert limits[-1] == "accuracy"
        assert triangles == sorted(triangles)
        assert triangles[-1] == cold.triangles


def test_float_vertices_are_offsets(db: mtdb.Database) -> None:
    hill = db["hills"]
    double, single = hill.extract(error=0.2), hill.extract(error=0.2, dtype=np.float32)
    assert single.vertices.dtype == np.float32
    np.testing.assert_allclose(single.vertices + single.origin, double.vertices, atol=1e-5)
    np.testing.assert_allclose(single.bounds, double.bounds, atol=1e-5)
    given = hill.extract(error=0.2, dtype="f4", origin=[1, 2, 3])
    np.testing.assert_array_equal(given.origin, [1, 2, 3])


def test_arrays_are_read_only_and_keep_their_memory(store: Path) -> None:
    db = mtdb.open(store)
    mesh = db["hills"].extract(normals=True)
    handle = weakref.ref(mesh._handle)
    arrays = {"vertices": mesh.vertices, "faces": mesh.faces, "colours": mesh.colours,
              "normals": mesh.normals, **mesh.attributes}
    copies = {name: np.array(a) for name, a in arrays.items()}
    for name, array in arrays.items():
        assert not array.flags.writeable, name
        with pytest.raises(ValueError):
            array[0] = 0
        with pytest.raises(ValueError):
            array.flags.writeable = True
    db.close()
    del mesh, db, array
    gc.collect()
    junk = [np.random.random(10000) for _ in range(100)]  # what might lie there now
    for name in list(arrays):
        np.testing.assert_array_equal(arrays[name], copies[name])
        assert handle() is not None
        del arrays[name]
    gc.collect()
    assert handle() is None  # freed with its last array
    del junk


def test_nothing_is_left_behind(db: mtdb.Database) -> None:
    hill = db["hills"]

    def work() -> None:
        mesh = hill.extract(error=0.05)
        with hill.session() as session:
            session.update(error=0.1)
        del mesh

    def resident() -> int:
        with open("/proc/self/statm") as statm:
            return int(statm.read().split()[1]) * 4096

    for _ in range(20):
        work()
    before = resident()
    for _ in range(100):
        work()
    gc.collect()
    assert resident() - before < 20 << 20


def test_threads_share_an_object(db: mtdb.Database) -> None:
    hill = db["hills"]
    expected = {e: hill.extract(error=e).faces.copy() for e in (0.01, 0.05, 0.2, 1.0)}
    wrong: list[str] = []

    def work(seed: int) -> None:
        rng = np.random.default_rng(seed)
        for _ in range(15):
            error = float(rng.choice(list(expected)))
            if not np.array_equal(hill.extract(error=error).faces, expected[error]):
                wrong.append(f"error {error}")
            hill.closest_point(rng.random(3) * 50)

    threads = [threading.Thread(target=work, args=(i,)) for i in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def test_probes(db: mtdb.Database) -> None:
    hill = db["hills"]
    hit = hill.cast_ray([10.1, 10.2, 500], [0, 0, -1])
    assert hit is not None and hit.front and abs(500 - hit.distance - hit.point[2]) < 1e-9
    twice = hill.cast_ray([10.1, 10.2, 500], [0, 0, -2])
    assert twice is not None and twice.parameter == hit.parameter / 2
    assert twice.distance == pytest.approx(hit.distance)
    near = hill.closest_point(hit.point + [0, 0, 1e-3])
    assert near is not None and near.distance <= 1e-3 and near.triangle.shape == (3, 3)
    assert near.parameter == 0
    assert hill.cast_ray([10, 10, 500], [0, 0, 1]) is None
    assert hill.closest_point([0, 0, 500], limit=1.0) is None
    with pytest.raises(mtdb.InvalidArgument):
        hill.closest_point([0, 0])
    with pytest.raises(mtdb.InvalidArgument):
        hill.cast_ray([0, 0, 0], [0, 0, 0])


def test_a_session_follows(db: mtdb.Database) -> None:
    hill = db["hills"]
    client = np.zeros((0, 3))
    streamed = 0

    def count(data: bytes) -> None:
        nonlocal streamed
        streamed += len(data)

    with hill.session() as session:
        for error in (1.0, 0.05, 0.3, 0.05):
            update = session.update(error=error, stream=count)
            expected = hill.extract(error=error)
            mesh = session.mesh()
            assert len(mesh.faces) == update.triangles == len(expected.faces)
            corners = lambda m: sorted(map(tuple, np.sort(  # noqa: E731
                m.vertices[m.faces].reshape(-1, 9), axis=1)))
            assert corners(mesh) == corners(expected)
            # A buffer to which only the changes are written.
            vertices = session.vertices
            client = np.resize(client, vertices.shape) if len(client) != len(vertices) else client
            if update.bytes:
                assert len(update.changed_faces)
            for begin, end in update.changed_vertices:
                client[begin:end] = vertices[begin:end]
            used = np.unique(session.faces)
            np.testing.assert_array_equal(client[used], vertices[used])
        assert streamed > 0
        session.update(box=[[0, 0, -9], [9, 9, 9]], clip=True)
        assert len(session.mesh().faces) < 0.2 * hill.triangles
        assert set(session.attributes) == {"red", "green", "blue", "heat"}
        with pytest.raises(ValueError):
            session.update(error=-1)
        with pytest.raises(ZeroDivisionError):
            session.update(error=0.0, stream=lambda data: 1 / 0)  # type: ignore[arg-type]
    with pytest.raises(mtdb.InvalidArgument, match="closed"):
        session.update(error=1)


def test_a_server_in_this_process(db: mtdb.Database, tmp_path: Path) -> None:
    with db.serve(threads=2) as server:
        url = server.url + "/objects/hills"
        with mtdb.connect(url) as session:
            update = session.update(error=0.1)
            assert update.triangles == len(db["hills"].extract(error=0.1).faces)
            assert len(session.mesh().faces) == update.triangles
            with pytest.raises(ZeroDivisionError):
                session.update(error=0.3, progress=lambda stage, done: 1 / 0)  # type: ignore
        out = str(tmp_path / "out.ply")
        told = mtdb.fetch(url, error=0.1, path=out)
        assert told.triangles == update.triangles == len(mtdb.read_mesh(out).faces)
        with db.serve() as second:
            assert second.url != server.url
    server.close()
    with pytest.raises(OSError):
        mtdb.connect(url)


def test_what_cannot_be_fetched_leaves_the_file(db: mtdb.Database, tmp_path: Path) -> None:
    kept = tmp_path / "part.ply"
    kept.write_bytes(b"before")
    with db.serve() as server:
        for url, query in ((f"{server.url}/objects/none", None), (f"{server.url}/objects/small", "{")):
            with pytest.raises(mtdb.MtdbError):
                mtdb.fetch(url, query, path=kept)
            assert kept.read_bytes() == b"before" and list(tmp_path.iterdir()) == [kept]
        mtdb.fetch(f"{server.url}/objects/small", path=kept)
    assert len(mtdb.read_mesh(kept).faces) == db["small"].triangles
    assert list(tmp_path.iterdir()) == [kept]


def test_a_child_leaves_the_parents_server_alone(db: mtdb.Database) -> None:
    server = db.serve()
    child = os.fork()
    if child == 0:
        try:
            server.close()
            os._exit(1)
        except mtdb.InvalidArgument:
            del server
            os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    assert len(mtdb.connect(f"{server.url}/objects/small").mesh().faces) >= 0
    server.close()


def test_pictures(db: mtdb.Database) -> None:
    hill = db["hills"]
    picture = hill.render((160, 120))
    assert picture.shape == (120, 160, 3) and picture.dtype == np.uint8 and picture.std() > 10
    camera = {"eye": [30, -20, 30], "target": [30, 30, 0]}
    seen = hill.render((160, 120), camera=camera, wireframe=True)
    assert seen.shape == picture.shape and np.any(seen != picture)
    assert mtdb.png(seen).startswith(b"\x89PNG")
    assert "data:image/png" in hill._repr_html_() and "<table>" in db._repr_html_()
    mesh = hill.extract(error=1)
    for style in ({"view": "top"}, {"up": [0, 1, 0]}, {"up": "-y"}, {"smooth": True}, {"draft": True},
                  {"hillshade": True}, {"colour": "height"},
                  {"colour": "normal"}, {"colour": hill.extract(error=3)}, {"scale_bar": True},
                  {"background": (255, 0, 0)}):
        drawn = mesh.render((160, 120), **style)
        assert drawn.shape == (120, 160, 3) and np.any(drawn != mesh.render((160, 120))), style
    assert np.array_equal(mesh.render((160, 120), up="y"), mesh.render((160, 120), up=[0, 1, 0]))
    clear = hill.render((160, 120), background="transparent", wireframe=True)
    assert clear.shape == (120, 160, 4) and 0 < (clear[:, :, 3] == 0).mean() < 0.9
    assert mtdb.png(clear)[25] == 6  # colour with alpha
    for bad in ({"colour": "nothing"}, {"view": "behind"}, {"background": "red"},
                {"background": (1, 2)}, {"colour": "normal", "up": [0, 0]}, {"up": "w"}):
        with pytest.raises(ValueError):
            mesh.render((160, 120), **bad)
    with pytest.raises(ValueError):
        hill.extract().render((0, 5))
    with pytest.raises(ValueError):
        hill.extract().render((10, 10), camera={"eye": [0, 0, 0]})


INTERRUPTED = """
import _thread, os, signal, sys, threading, time
import mtdb, numpy as np
sys.path.insert(0, sys.argv[2])
from conftest import hills
path, what = sys.argv[1], sys.argv[3]
db = mtdb.open(path, create=True)
def kill():
    os.kill(os.getpid(), signal.SIGINT)
if what == "ingest":
    v, f, _ = hills(300)
    try:
        threading.Timer(0.3, kill).start()
        while True:
            db.ingest(v, f, name="x", replace=True)
    except KeyboardInterrupt:
        print("interrupted", threading.active_count() >= 1)
elif what == "chunks":
    def endless():
        while True:
            v, f, _ = hills(30)
            yield v, f
    try:
        threading.Timer(0.3, kill).start()
        db.ingest(endless(), name="x", memory_bytes=1 << 30)
    except KeyboardInterrupt:
        print("interrupted", "x" in db)
elif what == "probe":
    # Nothing comes any more from where the packed file lies.
    import http.server
    data, stalled = open(path + "p", "rb").read(), threading.Event()
    class Ranges(http.server.BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"
        def do_GET(self):
            if stalled.is_set():
                time.sleep(60)
            first, last = self.headers["Range"].removeprefix("bytes=").split("-")
            first, last = int(first), min(int(last), len(data) - 1)
            self.send_response(206)
            self.send_header("Content-Range", f"bytes {first}-{last}/{len(data)}")
            self.send_header("Content-Length", str(last + 1 - first))
            self.send_header("ETag", '"1"')
            self.end_headers()
            self.wfile.write(data[first:last + 1])
        def log_message(self, *_):
            pass
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Ranges)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    o = mtdb.open(f"http://127.0.0.1:{server.server_port}/a.mtdbp")["hills"]
    stalled.set()
    for probe in (lambda: o.cast_ray([10, 10, 500], [0, 0, -1]), lambda: o.closest_point([9, 9, 9])):
        begin = time.monotonic()
        threading.Timer(0.5, kill).start()
        try:
            probe()
        except KeyboardInterrupt:
            assert time.monotonic() - begin < 30
            continue
        raise AssertionError("the probe did not wait")
    print("interrupted", flush=True)
    os._exit(0)
elif what == "late":
    # A signal that comes while no work is under way, or as it ends, cancels none that comes later.
    o = db["hills"]
    sys.setswitchinterval(0.5)  # the thread that hears of signals runs only while the library works
    for i in range(50):
        try:
            while True:  # Python loses what it raises in a destructor: then another signal
                threading.Timer(0.002, kill).start()
                until = time.monotonic() + 0.1
                while time.monotonic() < until:
                    o.extract(error=30.0)
        except KeyboardInterrupt:
            while True:
                try:
                    o.extract(error=30.0)
                    break
                except KeyboardInterrupt:  # of one more signal, on a slow machine
                    pass
    print("interrupted")
else:
    o = db["hills"]
    try:
        while True:
            threading.Timer(0.3, kill).start()
            until = time.monotonic() + 10
            while time.monotonic() < until:
                o.extract()
    except KeyboardInterrupt:
        print("interrupted", len(o.extract(error=1.0).faces) > 0)
"""


@pytest.mark.parametrize("what", ["ingest", "chunks", "extract", "late", "probe"])
def test_control_c_cancels(store: Path, tmp_path: Path, what: str) -> None:
    path = store if what in ("extract", "late") else tmp_path / "a.mtdb"
    if what == "probe":
        mtdb.open(store).pack(f"{path}p")
    told = subprocess.run(
        [sys.executable, "-c", INTERRUPTED, str(path), os.path.dirname(__file__), what],
        capture_output=True, text=True, timeout=300,
    )
    assert told.returncode == 0, told.stderr
    assert told.stdout.startswith("interrupted"), told.stdout + told.stderr


PEAK = """
import resource, sys
import mtdb, numpy as np
o = mtdb.open(sys.argv[1]).open_object("x", cache_bytes=64 << 20)
o.extract(error=1e9)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
mesh = o.extract()
arrays = mesh.vertices.nbytes + mesh.faces.nbytes
after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
print(after - before, arrays, len(mesh.faces))
"""


def test_the_peak_is_arrays_and_cache(tmp_path: Path) -> None:
    path = tmp_path / "a.mtdb"
    vertices, faces, _ = hills(500)
    mtdb.open(path, create=True).ingest(vertices, faces, name="x")
    told = subprocess.run([sys.executable, "-c", PEAK, str(path)], check=True,
                          capture_output=True, text=True)
    grown, arrays, triangles = map(int, told.stdout.split())
    assert triangles == len(faces)
    # The cache, a byte a node, blocks of output and the threads' decoders beside the arrays.
    assert grown < 1.1 * (arrays + (64 << 20)) + (32 << 20), (grown, arrays)
