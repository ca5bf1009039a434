# SPDX-License-Identifier: Apache-2.0
"""The tables and the sentences' figures of docs/BENCHMARKS.md, by the name that page.md.in has."""
import math

from raw import NotMeasured, Row, mesh_name, mib, millis, sig, size_name, table, whole

FIGURES = {}
METHODS = {"mtdb": "mtdb", "meshopt": "meshopt_simplify", "cgal_gh": "CGAL Garland-Heckbert",
           "cgal_lt": "CGAL Lindstrom-Turk"}


def figure(function):
    FIGURES[function.__name__] = function
    return function


def mean_ratio(values):
    """The geometric mean."""
    return math.exp(sum(map(math.log, values)) / len(values))


# The run.

@figure
def quick_warning(raw):
    return ("**A quick run on small data, to try the programs: these figures say nothing.**\n\n"
            if raw.quick else "")


@figure
def machine(raw):
    lines = []
    contexts = {}
    for name, step in raw.steps.items():
        context = Row(step["context"], f"step {name}, context")
        key = (context["commit"], context["compiler"])
        contexts.setdefault(key, (context, []))[1].append(name)
    first = max(contexts.values(), key=lambda c: len(c[1]))[0]
    m = first["machine"]
    lines.append(("machine", f"{m['cpu']}, {m['cores']} cores, {m['memory_bytes'] / 2**30:.0f} GiB,"
                             f" {m['system']}"))
    for context, names in contexts.values():
        of = "" if context is first else " (" + ", ".join(names) + ")"
        lines.append(("commit, compiler" + of, f"{context['commit']}, {context['compiler']}"))
    lines.append(("peers", ", ".join(f"{k} {v}" for k, v in first["peers"].items())))
    load = max(step["load"] for step in raw.steps.values())
    lines.append(("load before the steps", f"at most {load:.1f}"))
    return table(["", ""], lines)


@figure
def data_sets(raw):
    return table(["data set", "triangles", "vertices", "border edges", "non-manifold edges",
                  "from"],
                 [[r["name"], whole(r["triangles"]), whole(r["vertices"]),
                   whole(r["boundary_edges"]), whole(r["nonmanifold_edges"]), r["source"]]
                  for r in raw.rows("data_sets")])


# Quality.

def quality_meshes(raw):
    return list(dict.fromkeys(row["mesh"] for row in raw.rows("quality")))


@figure
def quality(raw):
    lines = []
    for mesh in quality_meshes(raw):
        for ratio in sorted({row["ratio"] for row in raw.rows("quality", mesh=mesh)}, reverse=True):
            rows = {r["method"]: r for r in raw.rows("quality", mesh=mesh, ratio=ratio)}
            best = min(r["hausdorff_rel"] for r in rows.values())
            cells = []
            for method in METHODS:
                value = rows[method]["hausdorff_rel"] if method in rows else None
                text = "-" if value is None else f"{1e3 * value:.3f}"
                cells.append(f"**{text}**" if value == best else text)
            lines.append([mesh_name(mesh), f"{100 * ratio:g} %",
                          whole(Row(rows, "quality")["mtdb"]["triangles"]), *cells])
    return table(["mesh", "ratio", "triangles", *METHODS.values()], lines)


@figure
def quality_best(raw):
    """In how many of the comparisons mtdb is the best."""
    groups = {}
    for row in raw.rows("quality"):
        groups.setdefault((row["mesh"], row["ratio"]), []).append(row)
    best = sum(min(group, key=lambda r: r["hausdorff_rel"])["method"] == "mtdb"
               for group in groups.values())
    return f"{best} of {len(groups)}"


def quality_ratio(raw, method):
    return mean_ratio([row["to_mtdb"] for row in raw.rows("quality", method=method)])


@figure
def quality_to_meshopt(raw):
    return f"{quality_ratio(raw, 'meshopt'):.2f}"


@figure
def quality_to_cgal(raw):
    return f"{quality_ratio(raw, 'cgal_gh'):.2f}"


@figure
def bounds(raw):
    meshes = list(dict.fromkeys(row["mesh"] for row in raw.rows("bounds")))
    steps = sorted({row["threshold_steps"] for row in raw.rows("bounds")})
    lines = []
    for mesh in meshes:
        ratios = {row["threshold_steps"]: row["ratio"] for row in raw.rows("bounds", mesh=mesh)}
        lines.append([mesh_name(mesh),
                      *(f"{ratios[s]:.3f}" if s in ratios else "-" for s in steps)])
    return table(["mesh"] + [whole(s) for s in steps], lines)


@figure
def bounds_range(raw):
    ratios = [row["ratio"] for row in raw.rows("bounds")]
    return f"{min(ratios):.3f} to {max(ratios):.3f}"


@figure
def bounds_forced(raw):
    return f"{max(row['forced_percent'] for row in raw.rows('bounds')):.1f} %"


# Build.

def ingest_cells(row):
    return [whole(row["triangles"]), row["threads"], row["memory"], sig(row["wall_seconds"]),
            sig(row["cpu_seconds"]), f"{1e-6 * row['triangles'] / row['cpu_seconds']:.3f}",
            mib(row["peak_rss_bytes"]), f"{row['bits_per_vertex']:.1f}", whole(row["depth"])]


INGEST_HEAD = ["triangles", "threads", "memory cap", "seconds", "processor seconds",
               "M triangles per core-second", "peak resident, MiB", "bits per vertex, whole file",
               "depth"]


@figure
def ingest(raw):
    return table(INGEST_HEAD, [ingest_cells(row) for row in raw.rows("ingest")])


@figure
def build(raw):
    lines = []
    for family, label in (("BM_Build", "mtdb, all levels"),
                          ("BM_MeshoptQuarter", "meshopt_simplify, to a quarter"),
                          ("BM_CgalQuarter", "CGAL Garland-Heckbert, to a quarter"),
                          ("BM_DracoEncode", "Draco, one level")):
        for row in raw.google("build", family):
            of = row["arguments"]
            if of.get("threads", 1) != 1:
                continue
            lines.append([label, whole(of["triangles"]), sig(1e-6 * row["per_core_second"])])
    return table(["in memory, one thread", "triangles", "M triangles per core-second"], lines)


# Size.

PACKED = ["draco_level_10", "draco_level_7", "zstd_level_19", "zstd_level_3"]


@figure
def size(raw):
    lines = []
    for row in raw.rows("size"):
        lines.append([mesh_name(row["mesh"]), whole(row["vertices"]),
                      f"{row['payload_bits_per_vertex']:.1f}", f"{row['file_bits_per_vertex']:.1f}",
                      *(f"{row[p]['bits_per_vertex']:.1f}" for p in PACKED),
                      f"{row['ply_bits_per_vertex']:.0f}", f"{row[PACKED[0]]['file_to_it']:.2f}"])
    return table(["mesh", "vertices", "payloads", "whole file", *(
        p.replace("_level_", " ") for p in PACKED), "PLY", "whole file / draco 10"], lines)


@figure
def rates(raw):
    key = "decode_mtriangles_per_core_second"
    return table(["mesh", "mtdb, decode", "mtdb, load", *(
        p.replace("_level_", " ") + ", decode" for p in PACKED)],
        [[mesh_name(row["mesh"]), sig(row[key]), sig(row["load_mtriangles_per_core_second"]),
          *(sig(row[p][key]) for p in PACKED)] for row in raw.rows("size")])


def size_to(raw, packed):
    return mean_ratio([row[packed]["file_to_it"] for row in raw.rows("size")])


@figure
def size_to_draco(raw):
    return f"{size_to(raw, 'draco_level_10'):.2f}"


@figure
def size_of_zstd(raw):
    return f"{1 / size_to(raw, 'zstd_level_19'):.1f}"


@figure
def streams(raw):
    rows = raw.rows("size")
    names = sorted({name for row in rows for name in row["stream_bits_per_vertex"]})
    return table(["mesh", *names], [[mesh_name(row["mesh"]), *(
        f"{row['stream_bits_per_vertex'].get(name, 0):.2f}" for name in names)] for row in rows])


@figure
def attributes(raw):
    lines = []
    for row in raw.rows("attributes"):
        parts = row["attribute_bits_per_vertex"]
        colours = f"{parts['red']:.2f}" if "red" in parts else "-"
        bits = row["normal_bits"]
        lines.append([mesh_name(row["mesh"]), bits or "lossless", f"{parts['nx']:.2f}", colours,
                      f"{row['payload_bits_per_vertex']:.2f}",
                      f"{row['file_bits_per_vertex']:.2f}"])
    return table(["mesh", "bits of a normal's component", "normals", "colours", "payloads",
                  "whole file"], lines)


# One region from nothing.

def beside(value, number):
    """A figure; a dash where there is nothing to measure."""
    return number(value) if value > 1e-5 else "-"


def region_costs(raw, step):
    return table(["sculpture of", "query", "triangles", "clusters read", "of", "KB of payloads",
                  "cold, ms", "warm, ms", "peak MiB"],
                 [[size_name(r["object_triangles"]), r["query"], whole(r["triangles"]),
                   whole(r["clusters_read"]), whole(r["clusters_total"]),
                   whole(r["payload_bytes_read"] / 1e3), millis(r["cold_seconds"]),
                   millis(r["warm_seconds"]), mib(r["peak_rss_bytes"])]
                  for r in raw.rows(step, method="mtdb")])


def region_peers(raw, step):
    lines = []
    rows = raw.rows(step)
    for hand in rows:
        if hand["method"] != "naive":
            continue
        ours = raw.row(step, method="mtdb", query=hand["query"],
                       object_triangles=hand["object_triangles"])
        line = [size_name(hand["object_triangles"]), hand["query"]]
        for row in (ours, hand):
            line += [whole(row["triangles"]), whole(row["storage_bytes_read"] / 1e3),
                     millis(row["cold_seconds"]), beside(row["warm_seconds"], millis),
                     mib(row["peak_rss_bytes"])]
        lines.append(line)
    head = ["triangles", "KB from disk", "cold, ms", "warm, ms", "peak MiB"]
    return table(["sculpture of", "query", *("mtdb: " + h if h == head[0] else h for h in head),
                  *("naive: " + h if h == head[0] else h for h in head)], lines)


@figure
def regions(raw):
    return region_costs(raw, "regions")


@figure
def naive(raw):
    return region_peers(raw, "regions")


def camera_row(raw, method):
    return next(r for r in raw.rows("regions", query="camera", method=method)
                if method == "mtdb" or "measured_error" in r)


@figure
def camera_asked(raw):
    return f"{camera_row(raw, 'naive')['asked_error']:.2g}"


@figure
def camera_measured(raw):
    row = camera_row(raw, "naive")
    return f"{row['measured_error'] / row['asked_error']:.1f}"


# Warm cuts, forms, threads.

@figure
def warm(raw):
    lines = []
    for row in raw.google("query", "BM_WarmUniform") + raw.google("query", "BM_WarmFull"):
        lines.append(["uniform" if row["arguments"] else "all", whole(row["triangles"]),
                      sig(1e-6 * row["items_per_second"]),
                      sig(row["select_M"]) if row["arguments"] else "-", sig(row["emit_M"]), "-"])
    for row in raw.google("query", "BM_WarmBox"):
        lines.append([f"box of {row['arguments']['per_mille'] / 10:g} % of the diagonal, full",
                      whole(row["triangles"]), sig(1e-6 * row["items_per_second"]),
                      sig(row["select_M"]), sig(row["emit_M"]),
                      whole(row["outside_percent"]) + " %"])
    return table(["cut", "triangles", "M triangles/s", "selecting alone", "emitting alone",
                  "outside / inside"], lines)


@figure
def warm_goal(raw):
    return f"{raw.published['goals']['warm_uniform_m']}"


@figure
def warm_wish(raw):
    return f"{raw.published['goals']['warm_uniform_wish_m']}"


@figure
def warm_range(raw):
    rates_m = [1e-6 * row["items_per_second"] for row in raw.google("query", "BM_WarmUniform")]
    return f"{min(rates_m):.0f} to {max(rates_m):.0f}"


def form_pairs(raw):
    rows = raw.google("query", "BM_FormUniform") + raw.google("query", "BM_FormBox")
    pairs = {}
    for row in rows:
        of = dict(row["arguments"])
        form = of.pop("implicit")
        pairs.setdefault((row["name"].split("/")[0], tuple(of.items())), {})[form] = row
    return pairs


@figure
def forms(raw):
    lines = []
    for (_, of), pair in form_pairs(raw).items():
        (what, value), = of
        label = (f"box of {value / 10:g} %, full" if what == "per_mille"
                 else "uniform" if value else "full resolution")
        plain, packed = pair[0], pair[1]
        lines.append([label, whole(plain["triangles"]), whole(plain["clusters"]),
                      sig(plain["cache_MB"]), sig(packed["cache_MB"]),
                      sig(plain["cache_MB"] / packed["cache_MB"], 2), sig(plain["cpu_time"]),
                      sig(packed["cpu_time"]), sig(packed["cpu_time"] / plain["cpu_time"], 2)])
    return table(["query", "triangles", "clusters", "explicit, MB", "implicit, MB", "ratio",
                  "explicit, ms", "implicit, ms", "ratio"], lines)


@figure
def published_larger(raw):
    return raw.published["paper"]["explicit_times_larger"]


@figure
def published_faster(raw):
    return raw.published["paper"]["explicit_times_faster"]


@figure
def threads(raw):
    return table(["threads", "cache MiB", "M triangles per processor second", "M triangles/s",
                  "median ms", "99th percentile ms", "resident MiB"],
                 [[row["arguments"]["threads"], row["arguments"]["cache_MB"], sig(row["cpu_M"]),
                   sig(1e-6 * row["items_per_second"]), sig(row["p50_ms"]), sig(row["p99_ms"]),
                   sig(row["resident_MB"])] for row in raw.google("query", "BM_Threads")])


@figure
def cold_full(raw):
    return ", ".join(f"{sig(1e-6 * row['items_per_second'])} with {row['arguments']['threads']} "
                     f"thread{'s' if row['arguments']['threads'] > 1 else ''}"
                     for row in raw.google("query", "BM_ColdFull"))


# What regions read.

def locality_lines(raw, step):
    return table(["error", "triangles of the store", "clusters read", "KB", "triangles", "CPU ms",
                  "to the first store: clusters", "KB", "triangles", "ms"],
                 [[f"{row['error']:g}", whole(row["store_triangles"]), whole(row["clusters"]),
                   whole(row["kilobytes"]), whole(row["triangles"]), whole(row["cpu_milliseconds"]),
                   f"{row['clusters_ratio']:.2f}", f"{row['kilobytes_ratio']:.2f}",
                   f"{row['triangles_ratio']:.2f}", f"{row['cpu_ratio']:.2f}"]
                  for row in raw.rows(step)])


@figure
def locality(raw):
    return locality_lines(raw, "locality")


@figure
def layouts(raw):
    return table(["tile triangles", "reduction", "file, bits per vertex", "clusters read",
                  "KB read",
                  "read / needed", "triangles", "CPU ms", "order", "values", "pages", "runs"],
                 [[row["tile_triangles"], row["reduction"], f"{row['bits_per_vertex']:.1f}",
                   f"{row['clusters']:.1f}", whole(row["kilobytes"]),
                   f"{row['read_to_needed']:.2f}", whole(row["triangles"]),
                   sig(row["cpu_milliseconds"]), row["order"], f"{row['values']:.1f}",
                   whole(row["pages"]), f"{row['runs']:.1f}"] for row in raw.rows("layouts")])


# Sessions, and the experiments of the paper.

SESSION_COLUMNS = ["path", "threshold", "object_triangles", "cut_triangles", "triangles", "nodes",
                   "inside", "held_triangles", "scratch_ms", "emit_ms", "update_ms",
                   "update_of_scratch", "update_encode_decode_ms", "at_once_ms", "encode_ms", "decode_ms", "insertions",
                   "removals", "new_triangles", "bytes", "bytes_per_new_triangle",
                   "draco_bytes_per_new_triangle"]


def session_kinds(raw):
    """The rows of session_bench by experiment."""
    kinds = {}
    for row in raw.rows("session"):
        kinds.setdefault(row["experiment"], []).append(row)
    return kinds


def cell(value):
    if isinstance(value, bool):
        return "yes" if value else ""
    if isinstance(value, str):
        return value
    return whole(value) if isinstance(value, int) else sig(value)


@figure
def sessions(raw):
    parts = []
    for kind, rows in session_kinds(raw).items():
        there = list(dict.fromkeys(key for row in rows for key in row if key != "experiment"))
        keys = [key for key in SESSION_COLUMNS if key in there]
        keys += [key for key in there if key not in keys]
        parts.append(f"**{kind}**\n\n" + table(
            [key.replace("_", " ").replace(" of scratch", " / scratch") for key in keys],
            [[cell(row.get(key, "-")) for key in keys] for row in rows]))
    return "\n\n".join(parts)


@figure
def paper(raw):
    p = raw.published["paper"]
    return f"{p['authors']}, \"{p['title']}\" ({p['year']})"


@figure
def year(raw):
    return raw.published["paper"]["year"]


@figure
def experiments(raw):
    p = raw.published["paper"]
    lines = []
    sweep = raw.row("session", experiment="sweep")
    lines.append(["bunny, a box that moves", whole(p["bunny_triangles"]), whole(p["bunny_inside"]),
                  p["bunny_ms"], whole(sweep["cut_triangles"]), whole(sweep["inside"]),
                  sig(sweep["scratch_ms"]), sig(sweep["update_ms"])])
    for row in raw.rows("terrain"):
        name = row.get("raster", "terrain") + f", {whole(row['object_triangles'])} triangles"
        lines.append([f"{name}, a wedge", whole(p["terrain_triangles"]),
                      whole(p["terrain_inside"]), p["terrain_ms"], whole(row["triangles"]),
                      whole(row["inside"]), sig(row["select_ms"]), sig(row["update_ms"])])
    return table(["", f"{p['year']}: triangles", "inside", "ms", "mtdb: triangles", "inside",
                  "from scratch, ms", "by update, ms"], lines)


@figure
def terrain_set_up(raw):
    return "; ".join(
        f"{row.get('raster', 'terrain')}: {whole(row['object_triangles'])} triangles, a wedge of "
        f"{row['wedge_degrees']:.0f} degrees, {row['slope']:.2g} of error per unit of distance"
        for row in raw.rows("terrain"))


@figure
def raster_sizes(raw):
    lines = []
    names = []
    for row in raw.rows("raster", what="build"):
        names += [name for name in row["packed"] if name not in names]
    for row in raw.rows("raster", what="build"):
        bits = [8 * row["file_bytes"] / row["samples"],
                *(8 * row[f"draco_level_{level}"]["bytes"] / row["samples"] for level in (10, 7)),
                *(8 * row["packed"][name] / row["samples"] if name in row["packed"] else None
                  for name in names)]
        lines.append([row["raster"], whole(row["samples"]),
                      *("" if n is None else sig(n) for n in bits)])
    return table(["", "samples", "mtdb, all levels", "Draco's slowest", "Draco level 7",
                  *names], lines)


@figure
def raster_cuts(raw):
    lines = []
    for row in raw.rows("raster", what="cut"):
        lines.append([row["raster"], sig(row["error"]), sig(row["measured"]),
                      sig(row["measured"] / row["error"]), whole(row["triangles"]),
                      whole(row["greedy"]), sig(row["triangles"] / row["greedy"]),
                      whole(row["meshoptimizer"]), sig(row["triangles"] / row["meshoptimizer"])])
    return table(["", "error", "measured", "measured / asked", "triangles", "greedy insertion",
                  "mtdb / it", "meshopt_simplify", "mtdb / it"], lines)


@figure
def raster_wire(raw):
    lines = []
    for row in raw.rows("raster", what="wire"):
        vertices = row["vertices"]
        lines.append([row["raster"], whole(vertices), row["triangles_by"], whole(row["steps"]),
                      sig(row["bits_per_vertex"]),
                      *(sig(1e6 * row[f"{end}_seconds"] / vertices)
                        for end in ("update", "encode", "decode"))])
    return table(["", "vertices sent", "triangles", "updates", "bits a vertex", "update, us",
                  "encode, us", "decode, us"], lines)


@figure
def raster_rates(raw):
    lines = []
    for row in raw.rows("raster", what="build"):
        draco = row["draco_level_10"]["encode_seconds"]
        lines.append([row["raster"], sig(1e-6 * row["triangles"] / row["build_seconds"]),
                      sig(1e-6 * row["triangles"] / draco), sig(draco / row["build_seconds"])])
    return table(["", "mtdb", "Draco's slowest", "mtdb / it"], lines)


@figure
def python(raw):
    row = raw.row("python")
    add = row["python_us"]
    return (f"A mesh of {whole(row['triangles'])} triangles: {sig(row['library_us'] / 1000)} ms by the "
            f"library's own calls, {sig(row['package_us'] / 1000)} ms through the package, "
            f"{100 * (row['package_us'] / row['library_us'] - 1):.1f} % more. An empty mesh costs "
            f"{sig(add)} µs more, which is Python's share of any extraction")


def pictures(raw, step):
    lines = []
    for row in raw.rows(step):
        if row["what"] not in ("first picture", "camera"):
            continue
        camera = row["what"] == "camera"
        lines.append([row["what"], row["line"], whole(row["triangles"]),
                      whole(row["clusters"]) if camera else "", sig(row["bytes"] / 1e3),
                      sig(row["bytes"] / row["bytes_needed"]) if camera else "",
                      row["requests"], row["round_trips"], sig(row["seconds"])])
    return table(["", "over", "triangles", "clusters", "KB", "times what it needs", "requests",
                  "round trips", "s"], lines)


@figure
def remote(raw):
    return pictures(raw, "remote")


@figure
def large_remote(raw):
    return pictures(raw, "large_remote")


@figure
def flight(raw):
    lines = []
    for row in raw.rows("remote", what="flight"):
        most = row["milliseconds"]
        lines.append(["to the end" if most is None else f"{sig(most)} ms", whole(row["triangles"]),
                      sig(row["cpu_mean_ms"]), sig(row["cpu_longest_ms"]), sig(row["longest_ms"]),
                      f"{row['on_the_way']} of {row['calls']}"])
    return table(["a call may take", "triangles at the end", "ms a call", "the longest",
                  "the longest, real time", "on the way"], lines)


@figure
def clients(raw):
    return table(["server", "clients at once", "a flight, s", "processor time for it, s",
                  "clients that a core serves"],
                 [[row["server"], row["clients"], sig(row["flight_seconds"]),
                   sig(row["cpu_seconds"]), sig(row["clients_per_core"])]
                  for row in raw.rows("remote", what="clients")])


@figure
def viewer(raw):
    lines = []
    for row in raw.rows("viewer"):
        if "drag_ms" in row:
            continue
        draco = row["way"] == "Draco"
        pairs = [row[key] for key in ("cut_ms", "worker_ms", "arrays_ms", "task_ms") if key in row]
        lines.append([whole(row["triangles"]), "the whole as Draco" if draco else row["way"],
                      row["network"], "" if draco else sig(row["first_seconds"]),
                      sig(row["exact_seconds"]), "" if draco else whole(row["exact_triangles"]),
                      sig(row["mesh_bytes"] / 1e6),
                      *(f"{sig(middle, 2)}, {sig(most, 2)}" for middle, most in pairs),
                      *([""] * (4 - len(pairs)))])
    return table(["triangles", "way", "network", "first mesh, s", "exact to a pixel, s",
                  "triangles then", "MB of mesh", "cut, ms", "worker, ms", "arrays, ms", "tasks, ms"], lines)


@figure
def viewer_drag(raw):
    return " ".join(
        f"Of {whole(row['triangles'])} triangles, {whole(row['drag_triangles'])} of which are shown "
        f"then: {sig(sorted(row['drag_ms'])[len(row['drag_ms']) // 2])} ms, at most "
        f"{sig(max(row['drag_ms']))}." for row in raw.rows("viewer") if "drag_ms" in row)


@figure
def viewer_browser(raw):
    return raw.rows("viewer")[0]["chromium"]


# The large model.

@figure
def large_triangles(raw):
    return whole(raw.row("large_ingest", what="ingest")["triangles"])


@figure
def large_ingest(raw):
    row = raw.row("large_ingest", what="ingest")
    if row["resumed"]:
        return (f"It was stopped and went on, so that there are no times of the whole: "
                f"{row['bits_per_vertex']:.1f} bits per vertex, depth {row['depth']}.")
    return table(INGEST_HEAD, [ingest_cells(row)])


@figure
def large_regions(raw):
    return region_costs(raw, "large_regions")


@figure
def large_naive(raw):
    if not any(row["method"] == "naive" for row in raw.rows("large_regions")):
        return "This machine's memory does not hold the whole mesh, as the naive user wants it."
    return region_peers(raw, "large_regions")


@figure
def large_locality(raw):
    return locality_lines(raw, "large_locality")


@figure
def large_cache(raw):
    return mib(raw.row("large_regions", method="mtdb")["cache_bytes"])


@figure
def large_verify(raw):
    return sig(raw.row("large_verify")["wall_seconds"])


# The README.

def ingested(raw):
    """What was ingested in one go."""
    rows = raw.rows("ingest")
    try:
        rows += [r for r in raw.rows("large_ingest", what="ingest") if not r["resumed"]]
    except NotMeasured:
        pass
    return rows


def raster_to_greedy(raw):
    """Triangles of greedy insertion, as a part of mtdb's at the same error."""
    return sig(mean_ratio([row["greedy"] / row["triangles"]
                           for row in raw.rows("raster", what="cut")]), 2)


@figure
def summary(raw):
    lines = []
    rows = raw.rows("size")
    row = max(rows, key=lambda r: r["vertices"] * r["mesh"].startswith("sculpture"))
    built = max(ingested(raw), key=lambda r: (r["triangles"], r["threads"]))
    lines.append([f"rate of an ingest of {size_name(built['triangles'])} triangles under "
                  f"{built['memory']} of memory; higher is better",
                  f"{sig(1e-6 * built['triangles'] / built['wall_seconds'])} M triangles/s, "
                  f"{mib(built['peak_rss_bytes'])} MiB at the peak", "-"])
    lines.append([f"size of all levels of the {mesh_name(row['mesh'])}, without attributes, "
                  "bits per vertex; lower is better",
                  f"{row['file_bits_per_vertex']:.1f}",
                  f"one level: Draco {row['draco_level_10']['bits_per_vertex']:.1f}, "
                  f"zstd -19 {row['zstd_level_19']['bits_per_vertex']:.0f}"])
    lines.append(["largest distance from the input at equal triangles, relative to mtdb's, mean "
                  "over meshes and ratios; lower is better", "1",
                  f"meshoptimizer {quality_to_meshopt(raw)}, CGAL {quality_to_cgal(raw)}"])
    try:
        lines.append(["triangles of a terrain at equal error, relative to mtdb's; lower is better",
                      "1", f"greedy insertion {raster_to_greedy(raw)}, its error held at samples only"])
    except NotMeasured:
        pass
    dense = max(r["object_triangles"] for r in raw.rows("regions"))
    box = [r for r in raw.rows("regions", object_triangles=dense) if "box, 1 %" in r["query"]]
    ours, hand = (next(r for r in box if r["method"] == m) for m in ("mtdb", "naive"))
    lines.append([f"time and memory of a box with 1 % of {size_name(dense)} triangles, from "
                  "nothing; lower is better",
                  f"{millis(ours['cold_seconds'])} ms, {mib(ours['peak_rss_bytes'])} MiB",
                  f"load and crop: {millis(hand['cold_seconds'])} ms, "
                  f"{mib(hand['peak_rss_bytes'])} MiB"])
    lines.append(["rate of uniform cuts from warm clusters, one thread; higher is better",
                  f"{warm_range(raw)} M triangles/s", "-"])
    return table(["", "mtdb", "peers"], lines)


@figure
def picture_caption(raw):
    row = raw.row("picture")
    return (f"A box of full resolution in a surface that is otherwise as coarse as it goes: "
            f"{whole(row['triangles'])} of {whole(row['object_triangles'])} triangles in one "
            "conforming mesh")
