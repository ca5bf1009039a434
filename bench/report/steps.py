# SPDX-License-Identifier: Apache-2.0
"""What tools/benchmark measures: each function is a step and returns its rows (runner.py)."""
import json
import math
import os
import pathlib
import random
import shutil
import struct
import subprocess
import tarfile

from runner import ROOT, Failed, Unavailable, forget_file, require_space

PACKAGED = pathlib.Path("/usr/share/doc/libcgal-dev/data.tar.gz")  # of libcgal-demo
PACKAGED_MESHES = ["bunny00.off", "armadillo.off", "refined_elephant.off"]
SHARED = pathlib.Path(os.environ.get("MTDB_DATA", ROOT.parent / "shared" / "data"))
SHARED_MESHES = ["bunny.ply", "nefertiti.ply", "horse_bigendian_colours.ply",
                 "laurana_colours_normals.ply", "skull.obj",
                 "dragon_res2_ascii_nonmanifold.ply", "rangescan_ascii_boundary.ply"]
SHARES = [0.001, 0.01, 0.1]  # of a surface's triangles, in boxes
VIEW = {"fov": 45, "viewport": [1200, 900]}
PIXELS = 1
RASTER_ERRORS = [1, 5, 20]  # in metres
INGEST_BYTES_PER_TRIANGLE = 130  # of the store and its temporary files, with room to spare
MESH_BYTES_PER_TRIANGLE = 20
GENERATE_BYTES_PER_TRIANGLE = 2 * 13 + 6  # the faces twice, the vertices once
RUN_BYTES_PER_TRIANGLE = INGEST_BYTES_PER_TRIANGLE + MESH_BYTES_PER_TRIANGLE
NAIVE_BYTES_PER_TRIANGLE = 80  # of memory

FULL = {
    "sculpture": 2000000, "dense": 20000000, "dense_memory": "512M", "bounds": 1000000,
    "quality": 200000, "ratios": [0.3, 0.1, 0.03, 0.01, 0.003], "samples": 200000,
    "codec": [1000000, 2000000], "terrain": [1000000], "session": 400000, "frames": 60,
    "picture": 60000, "min_time": 0.5, "build": [100000, 1000000], "boxes": 100,
    "normal_bits": [0, 8, 10, 12], "python_rounds": 200, "raster": 241,
    "whole_rasters": True, "flight": 300000,
    "scans": SHARED_MESHES + PACKAGED_MESHES,
}
QUICK = {
    "sculpture": 100000, "dense": 300000, "dense_memory": "256M", "bounds": 20000,
    "quality": 20000, "ratios": [0.1, 0.01], "samples": 10000,
    "codec": [50000], "terrain": [50000], "session": 50000, "frames": 10,
    "picture": 60000, "min_time": 0.01, "build": [100000], "boxes": 10, "normal_bits": [0, 10],
    "python_rounds": 20, "raster": 101, "whole_rasters": False, "flight": 20000,
    "scans": ["laurana_colours_normals.ply", "bunny00.off"],
}
LARGE = {"triangles": 100000000, "small": 2000000, "memory": "1G", "cache_mb": 256, "boxes": 100}
LARGE_QUICK = {"triangles": 1000000, "small": 100000, "memory": "256M", "cache_mb": 256,
               "boxes": 10}


class Data:
    """Meshes and stores in a folder, made by this commit when they are first wanted. Those of other
    commits are removed; with `again`, those of this one too."""

    def __init__(self, runner, folder, again):
        self.runner = runner
        self.folder = folder / runner.context["commit"]
        self.sizes = runner.settings
        for other in folder.iterdir() if folder.exists() else []:
            if other != self.folder or again:
                shutil.rmtree(other) if other.is_dir() else other.unlink()
        self.folder.mkdir(parents=True, exist_ok=True)

    def generated(self, shape, triangles):
        path = self.folder / f"{shape}-{triangles}.ply"
        if not path.exists():
            for part in self.folder.glob(path.name + ".*.part*"):  # of a run that was killed
                part.unlink()
            require_space(self.folder, GENERATE_BYTES_PER_TRIANGLE * triangles, "generation")
            self.runner.run(self.runner.build / "tools" / "mtdb", "generate", shape, path,
                            "--triangles", triangles)
        return path

    def store(self, mesh, *options):
        """A store of one mesh, and what its ingest took when it was made now."""
        path = self.folder / (mesh.stem + ".mtdb")
        try:
            if self.runner.mtdb("list", path)[0]["objects"]:
                return path, None
        except Failed:
            pass
        return path, self.runner.mtdb("ingest", mesh, path, "--bits", 16, "--resume", *options)[1]

    def scans(self):
        """Paths of the scans of this run that are on this machine."""
        if PACKAGED.exists():
            with tarfile.open(PACKAGED) as archive:
                for name in PACKAGED_MESHES:
                    if name in self.sizes["scans"] and not (self.folder / name).exists():
                        content = archive.extractfile(f"data/meshes/{name}").read()
                        partial = self.folder / (name + ".partial")
                        partial.write_bytes(content)
                        partial.rename(self.folder / name)
        places = [SHARED, self.folder]
        return [place / name for name in self.sizes["scans"] for place in places
                if (place / name).exists() and (place != self.folder or name in PACKAGED_MESHES)]

    def scan(self, name):
        for path in self.scans():
            if path.name == name:
                return path
        raise Unavailable(f"{name} is not in {SHARED}")

    def bunny(self):
        for path in self.scans():
            if "bunny" in path.name:
                return path
        raise Unavailable(f"no bunny: neither {SHARED} nor the package libcgal-demo is here")


def data_sets(runner, data):
    rows = []
    store = data.folder / "scans.mtdb"
    require_space(data.folder, RUN_BYTES_PER_TRIANGLE * data.sizes["dense"], "the run")
    for path in data.scans():
        info = runner.mtdb("ingest", path, store, "--name", path.stem, "--bits", 16, "--replace")[0]
        source = "package libcgal-demo" if path.parent == data.folder else "shared/data"
        rows.append({"name": path.name, "triangles": info["input"]["triangles"],
                     "vertices": info["input"]["vertices"], "source": source,
                     "boundary_edges": info["boundary_edges"],
                     "nonmanifold_edges": info["input"]["nonmanifold_edges"]})
    sizes = data.sizes
    for shape, triangles in ([("sculpture", n) for n in sorted({sizes["quality"], sizes["bounds"],
                                                                sizes["sculpture"]})]
                             + [("terrain", n) for n in sizes["terrain"]]):
        path = data.generated(shape, triangles)
        info = runner.mtdb("ingest", path, store, "--name", path.stem, "--bits", 16, "--replace")[0]
        rows.append({"name": path.name, "triangles": info["input"]["triangles"],
                     "vertices": info["input"]["vertices"], "source": f"mtdb generate {shape}",
                     "boundary_edges": info["boundary_edges"],
                     "nonmanifold_edges": info["input"]["nonmanifold_edges"]})
    store.unlink()
    return rows


def quality(runner, data):
    meshes = data.scans() + [data.generated("sculpture", data.sizes["quality"])]
    return runner.rows("quality_bench", *meshes, "--measure-only", "--samples",
                       data.sizes["samples"], "--ratio", *data.sizes["ratios"])


def bounds(runner, data):
    meshes = [path for path in data.scans() if "bunny" in path.name or "rangescan" in path.name]
    meshes.append(data.generated("sculpture", data.sizes["bounds"]))
    return runner.rows("quality_bench", "--bounds", *meshes, "--samples",
                       data.sizes["samples"] // 2)


def build(runner, data):
    sizes = "|".join(str(n) for n in data.sizes["build"])
    return runner.google_rows("build_bench", f"--benchmark_filter=:({sizes})(/|$)",
                              f"--benchmark_min_time={data.sizes['min_time']}")


def ingest_row(info, used, threads, memory):
    return {"triangles": info["triangles"], "vertices": info["vertices"], "threads": threads,
            "memory": memory, "bits_per_vertex": 8 * info["file_bytes"] / info["vertices"],
            "clusters": info["clusters"], "depth": info["depth"], **used}


def ingest(runner, data):
    rows = []
    out = data.folder / "ingest.mtdb"
    cores = runner.context["machine"]["cores"]
    for triangles, threads, memory in ((data.sizes["sculpture"], 1, "6G"),
                                       (data.sizes["sculpture"], cores, "6G"),
                                       (data.sizes["dense"], cores, data.sizes["dense_memory"])):
        mesh = data.generated("sculpture", triangles)
        require_space(data.folder, INGEST_BYTES_PER_TRIANGLE * triangles, "ingest")
        out.unlink(missing_ok=True)
        info, used = runner.mtdb("ingest", mesh, out, "--bits", 16, "--threads", threads, "--memory",
                                 memory)
        rows.append(ingest_row(info, used, threads, memory))
    out.unlink()
    return rows


def size(runner, data):
    generated = []
    for shape, key in (("--sculpture", "codec"), ("--terrain", "terrain")):
        for triangles in data.sizes[key]:
            generated += [shape, triangles]
    return runner.rows("codec_bench", *data.scans(), *generated)


def attributes(runner, data):
    meshes = [p for p in data.scans() if "normals" in p.name or "rangescan" in p.name]
    if not meshes:
        raise Unavailable(f"no mesh with normals is in {SHARED}")
    rows = []
    for bits in data.sizes["normal_bits"]:
        normals = ["--normals", bits] if bits else []
        for row in runner.rows("codec_bench", *meshes, "--attributes", *normals, "--no-peers"):
            del row["models"]
            rows.append({"normal_bits": bits, **row})
    return rows


def query(runner, data):
    return runner.google_rows("query_bench", f"--triangles={data.sizes['sculpture']}",
                              f"--benchmark_min_time={data.sizes['min_time']}")


def sampled_stores(data):
    return [data.store(data.generated("sculpture", data.sizes[key]))[0]
            for key in ("sculpture", "dense")]


def locality(runner, data):
    return runner.rows("locality_bench", "stores", "--queries", data.sizes["boxes"],
                       *sampled_stores(data))


def layouts(runner, data):
    return runner.rows("locality_bench", "layouts", "--triangles", data.sizes["sculpture"],
                       "--queries", data.sizes["boxes"])


def region_queries(boxes, whole):
    """What is asked for: a label, the query, and what the naive user does for it."""
    queries = []
    if whole:
        queries.append(("whole, full", {}, []))
    queries += [("whole, error 0.001", {"threshold": {"relative": 0.001}}, None),
                ("whole, error 0.0001", {"threshold": {"relative": 0.0001}}, None)]
    for box in boxes:
        corners = ",".join(repr(x) for x in box["min"] + box["max"])
        queries.append((f"box, {100 * box['share']:g} %, full",
                        {"region": {"box": {"min": box["min"], "max": box["max"]}}},
                        ["--box=" + corners]))
    camera = {"eye": boxes[0]["eye"], "target": boxes[0]["centre"], **VIEW}
    queries.append(("camera", {"region": {"frustum": camera},
                               "threshold": {"screen": {"camera": camera, "pixels": PIXELS}}},
                    ["--error", repr(error_at_target(camera))]))
    return queries


def error_at_target(camera):
    """What the pixels stand for, in model units, where the camera looks at."""
    pixel = 2 * math.tan(math.radians(camera["fov"]) / 2) / camera["viewport"][1]
    return PIXELS * pixel * math.dist(camera["eye"], camera["target"])


def ask(runner, mesh, store, queries, cache_mb, naive, samples, repeat):
    rows = []
    for label, asked, by_hand in queries:
        forget_file(store)
        for row in runner.rows("extract_bench", "store", store, "--query", json.dumps(asked),
                               "--cache-mb", cache_mb, "--repeat", 3):
            rows.append({"query": label, **row})
        if by_hand is None or not naive:
            continue
        forget_file(mesh)
        extra = ["--samples", samples] if "--error" in by_hand and samples else []
        for row in runner.rows("extract_bench", "naive", mesh, *by_hand, *extra,
                               "--repeat", repeat):
            rows.append({"query": label, **row})
            if "--error" in by_hand:
                rows[-1]["asked_error"] = float(by_hand[1])
    return rows


def one_of_each(commands):
    """The first command of each program and verb: the others differ in the query alone."""
    first = {}
    for command in commands:
        first.setdefault(tuple(command.split()[:2]), command)
    return list(first.values())


def boxes_of(runner, data, triangles):
    """Boxes of the sculpture, which has the same shape in all samplings."""
    return runner.rows("extract_bench", "boxes", data.generated("sculpture", triangles),
                       "--share", *SHARES)


def regions(runner, data):
    queries = region_queries(boxes_of(runner, data, data.sizes["sculpture"]), whole=True)
    rows = []
    for key, samples, repeat in (("sculpture", data.sizes["samples"], 3), ("dense", 0, 1)):
        mesh = data.generated("sculpture", data.sizes[key])
        rows += ask(runner, mesh, data.store(mesh)[0], queries, 256, True, samples, repeat)
    runner.commands = one_of_each(runner.commands)
    return rows


def session(runner, data):
    frames = ["--frames", data.sizes["frames"]]
    dense = data.store(data.generated("sculpture", data.sizes["dense"]))[0]
    return (runner.rows("session_bench", *frames, "--large", data.sizes["session"], data.bunny())
            + runner.rows("session_bench", *frames, "--store", dense))


def packed(runner, store):
    path = store.with_suffix(".mtdbp")
    runner.mtdb("pack", store, path)
    return path


def remote_pictures(runner, path):
    rows = runner.rows("remote_bench", "pictures", path)
    if not rows:
        raise Unavailable("nginx is not installed (package nginx)")
    return rows


def remote(runner, data):
    """A packed file on nginx; flights of an engine that never waits."""
    path = packed(runner, data.store(data.generated("sculpture", data.sizes["dense"]))[0])
    frames = ["--frames", data.sizes["frames"]]
    return (remote_pictures(runner, path)
            + runner.rows("remote_bench", "flight", path, *frames,
                          "--triangles", data.sizes["flight"])
            + runner.rows("remote_bench", "clients", path, *frames, "--mtdb",
                          runner.build / "tools" / "mtdb"))


def terrain(runner, data):
    """The generated terrain, and as many samples of the mountain of then."""
    frames = ["--frames", data.sizes["frames"]]
    rows = runner.rows("terrain_bench", *frames)
    helens = SHARED / "SainteHelens.dem"
    if helens.exists():
        rows += [{"raster": helens.name, **row}
                 for row in runner.rows("terrain_bench", "--raster", helens, *frames)]
    return rows


def raster_side(path):
    """Samples along a side of a tile of SRTM."""
    return math.isqrt(path.stat().st_size // 2)


def raster_heights(path, columns, rows):
    """The north-western samples of a tile of SRTM, row by row."""
    content = path.read_bytes()
    side = raster_side(path)
    heights = struct.unpack(f">{side * rows}h", content[:2 * side * rows])
    return [heights[side * row:side * row + columns] for row in range(rows)]


def generated_heights(side):
    """Fractal hills by midpoint displacement, in whole metres."""
    random_numbers = random.Random(7)
    size = 1 << (side - 1).bit_length()
    at = {(x, y): 800.0 for x in (0, size) for y in (0, size)}
    step, roughness = size, 300.0
    while step > 1:
        half = step // 2
        for x in range(half, size, step):
            for y in range(half, size, step):
                corners = [at[x + i, y + j] for i in (-half, half) for j in (-half, half)]
                at[x, y] = sum(corners) / 4 + random_numbers.uniform(-roughness, roughness)
        for x in range(0, size + 1, half):
            for y in range((x + half) % step, size + 1, step):
                beside = [at[p] for p in ((x - half, y), (x + half, y), (x, y - half), (x, y + half))
                          if p in at]
                at[x, y] = sum(beside) / len(beside) + random_numbers.uniform(-roughness, roughness)
        step, roughness = half, roughness * 0.55
    return [[round(at[x, y]) for x in range(side)] for y in range(side)]


def write_raster(path, rows):
    """An ASCII grid, in metres, one sample each 30 m."""
    head = (f"ncols {len(rows[0])}\nnrows {len(rows)}\nxllcorner 0\nyllcorner 0\ncellsize 30\n"
            "NODATA_value -32768\n")
    path.write_text(head + "\n".join(" ".join(map(str, row)) for row in rows) + "\n")
    return path


def packed_sizes(runner, path, rows):
    """Bytes of the samples, in 16 bits, as other programs pack them; those that are not here are
    left out."""
    samples = path.with_suffix(".bin")
    samples.write_bytes(b"".join(struct.pack(f"<{len(row)}h", *row) for row in rows))
    sizes = {"plain": samples.stat().st_size}
    for name, command in (("xz -9", ["xz", "-9", "-k", "-c", samples]),
                          ("zstd -19", ["zstd", "-q", "-19", "-c", samples])):
        if shutil.which(command[0]):
            sizes[name] = len(subprocess.run(command, capture_output=True, check=True).stdout)
    for name, options in (("GeoTIFF, Deflate", ["COMPRESS=DEFLATE", "PREDICTOR=2", "ZLEVEL=9"]),
                          ("GeoTIFF, LERC", ["COMPRESS=LERC_DEFLATE", "MAX_Z_ERROR=0"])):
        out = path.with_suffix(".tif")
        command = ["gdal_translate", "-q", "-ot", "Int16", path, out]
        for option in options:
            command += ["-co", option]
        if shutil.which("gdal_translate") and subprocess.run(command,
                                                             capture_output=True).returncode == 0:
            sizes[name] = out.stat().st_size
    return sizes


def raster(runner, data):
    """Rasters of heights as terrains: real ones where they are here, and a generated one."""
    side = data.sizes["raster"]
    tiles = [SHARED / name for name in ("N37W120.hgt", "N38W120.hgt") if (SHARED / name).exists()]
    rasters = [("generated", generated_heights(side), RASTER_ERRORS)]
    rasters += [(tile.name, raster_heights(tile, side, side), RASTER_ERRORS) for tile in tiles]
    if data.sizes["whole_rasters"]:
        rasters += [(tile.stem + " whole", raster_heights(tile, raster_side(tile),
                                                          raster_side(tile)), []) for tile in tiles]
    result = []
    for name, rows, asked in rasters:
        path = write_raster(data.folder / (name.split(".")[0].replace(" ", "_") + ".asc"), rows)
        errors = [part for error in asked for part in ("--error", error)]
        for row in runner.rows("raster_bench", path, *errors):
            packed = {"packed": packed_sizes(runner, path, rows)} if row["what"] == "build" else {}
            result.append({"raster": name, **row, **packed})
    runner.commands = one_of_each(runner.commands)
    return result


def picture(runner, data):
    """One box at full resolution in a coarse whole, drawn for the README."""
    store = data.store(data.generated("sculpture", data.sizes["picture"]))[0]
    drawn = runner.mtdb("render", store, runner.results / "box.png", "--full",
                        "--box=-0.2,-0.5,0.1,0.4,0.1,0.7", "--wireframe", "--size", "800x600")[0]
    whole = runner.mtdb("info", store)[0]["objects"][0]
    return [{"triangles": drawn["triangles"], "object_triangles": whole["triangles"]}]


def python(runner, data):
    """A mesh of some 100,000 triangles through the Python package, beside the library's own calls."""
    interpreter = "/usr/bin/python3" if pathlib.Path("/usr/bin/python3").exists() else "python3"
    if subprocess.run([interpreter, "-c", "import numpy"], capture_output=True).returncode != 0:
        raise Unavailable(f"{interpreter} has no numpy (package python3-numpy)")
    script = ["tools/python/overhead.py", "--rounds", data.sizes["python_rounds"]]
    out, _ = runner.run("env", "PYTHONPATH=" + str(ROOT / "tools" / "python"),
                        "PYTHONDONTWRITEBYTECODE=1",
                        "MTDB_LIBRARY=" + str(runner.build / "tools" / "libmtdb.so"), interpreter,
                        *script, "--json", shown=script)
    return [json.loads(out)]


def viewer(runner, data):
    """The page in Chromium, over two networks, beside one that downloads the whole as Draco."""
    build = runner.build / "viewer"
    if not (build / "page" / "index.html").exists():
        raise Unavailable("mtdb was built without the viewer (tools/viewer/README.md)")
    if not pathlib.Path("/usr/bin/chromium").exists():
        raise Unavailable("Chromium is not installed (package chromium)")
    stores = [data.store(data.generated("sculpture", triangles))[0]
              for triangles in (data.sizes["sculpture"], data.sizes["dense"])]
    script = ["tests/viewer/figures.mjs", "--json", *stores]
    out, _ = runner.run("env", f"MTDB_BINARY={runner.build / 'tools' / 'mtdb'}",
                        f"MTDB_VIEWER_BUILD={build}", "node", *script,
                        shown=["node", "tests/viewer/figures.mjs", *(store.name for store in stores)])
    answer = json.loads(out)
    return [{"chromium": answer["chromium"], **row} for row in answer["rows"]]


def large_ingest(runner, data):
    """Goes on where it was stopped; what it took is then what the last part took."""
    triangles, memory = data.sizes["triangles"], data.sizes["memory"]
    path = data.folder / f"sculpture-{triangles}.ply"
    was_there = path.exists()
    mesh = data.generated("sculpture", triangles)
    rows = [] if was_there else [{"what": "generate", "triangles": triangles, **runner.used}]
    store = mesh.with_suffix(".mtdb")
    if not store.exists():
        require_space(data.folder, INGEST_BYTES_PER_TRIANGLE * triangles, "ingest")
    resumed = store.exists()
    _, used = data.store(mesh, "--memory", memory)
    info = runner.mtdb("info", store)[0]["objects"][0]
    cores = runner.context["machine"]["cores"]
    rows.append({"what": "ingest", "resumed": resumed or used is None,
                 **ingest_row(info, used or {}, cores, memory)})
    return rows


def large_files(data):
    mesh = data.generated("sculpture", data.sizes["triangles"])
    return mesh, data.store(mesh, "--memory", data.sizes["memory"])[0]


def large_regions(runner, data):
    mesh, store = large_files(data)
    queries = region_queries(boxes_of(runner, data, data.sizes["small"]),
                             whole=False)
    memory = runner.context["machine"]["memory_bytes"]
    naive = NAIVE_BYTES_PER_TRIANGLE * data.sizes["triangles"] < 0.7 * memory
    queries = [(label, asked, None if by_hand and "--error" in by_hand else by_hand)
               for label, asked, by_hand in queries]
    rows = ask(runner, mesh, store, queries, data.sizes["cache_mb"], naive, 0, 1)
    runner.commands = one_of_each(runner.commands)
    return rows


def large_locality(runner, data):
    small = data.store(data.generated("sculpture", data.sizes["small"]))[0]
    return runner.rows("locality_bench", "stores", "--queries", data.sizes["boxes"], small,
                       large_files(data)[1])


def large_remote(runner, data):
    return remote_pictures(runner, packed(runner, large_files(data)[1]))


def large_verify(runner, data):
    store = large_files(data)[1]
    forget_file(store)
    report, used = runner.mtdb("verify", store, "--level", "full")
    return [{"ok": report["ok"], **used}]


STEPS = [data_sets, quality, bounds, build, ingest, size, attributes, query, locality, layouts,
         regions, session, remote, terrain, raster, python, viewer, picture]
LARGE_STEPS = [large_ingest, large_regions, large_locality, large_remote, large_verify]
