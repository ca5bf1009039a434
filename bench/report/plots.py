# SPDX-License-Identifier: Apache-2.0
"""The plots of docs/BENCHMARKS.md, drawn by gnuplot from the raw file."""
import subprocess

import tables
from raw import mesh_name, size_name

# Told apart by all eyes (Okabe and Ito), and by their marks.
COLOURS = ["#0072B2", "#E69F00", "#009E73", "#CC79A7"]
PAIRS = ["#0072B2", "#56B4E9", "#D55E00", "#E69F00"]  # two of a kind, dark and light
MARKS = [7, 5, 9, 11]
SET_UP = """
set encoding utf8
set border 3 lw 1 lc rgb "#666666"
set tics nomirror out textcolor rgb "#333333"
set grid ytics lt 1 lw 1 lc rgb "#CCCCCC"
set key outside top center horizontal noenhanced samplen 2 textcolor rgb "#333333"
set title font ",14" noenhanced
"""


def draw(path, width, height, script):
    terminal = (f'set terminal svg size {width},{height} dynamic font "sans-serif,12" '
                f'background "white"\nset output "{path}"\n')
    subprocess.run(["gnuplot"], input=terminal + SET_UP + script, text=True, check=True)


def block(name, lines):
    return f"${name} << EOD\n" + "\n".join(" ".join(map(str, line)) for line in lines) + "\nEOD\n"


def quoted(text):
    return '"' + text.replace('"', "") + '"'


def curves(named):
    """The plot command of lines with marks: name -> points."""
    data = "".join(block(f"c{i}", points) for i, points in enumerate(named.values()))
    return data, ", ".join(
        f'$c{i} with linespoints lw 2 pt {MARKS[i]} ps 0.8 lc rgb "{COLOURS[i]}" '
        f"title {quoted(name)}" for i, name in enumerate(named))


def bars(named, labels, tilt=False, colours=COLOURS):
    """Bars in groups: name -> one value (or None) for each label."""
    wide = 0.8 / len(named)
    data = "set style fill solid 0.9 noborder\nset xrange [-0.6:%g]\n" % (len(labels) - 0.4)
    tics = (f"{quoted(label.replace('%', '%%'))} {i}" for i, label in enumerate(labels))
    data += "set xtics (" + ", ".join(tics) + ")"
    data += " noenhanced rotate by -30 left\n" if tilt else " noenhanced\n"
    for s, values in enumerate(named.values()):
        data += block(f"b{s}", [(i + (s - 0.5 * (len(named) - 1)) * wide, v)
                                for i, v in enumerate(values) if v is not None] or [("NaN", "NaN")])
    return data + "plot " + ", ".join(
        f'$b{s} with boxes lc rgb "{colours[s]}" title {quoted(name)}'
        for s, name in enumerate(named)) + "\n", f"set boxwidth {0.92 * wide}\n"


def error_over_triangles(raw, path):
    meshes = tables.quality_meshes(raw)
    shown = list(dict.fromkeys([meshes[0], meshes[-1]]))
    script = ('set logscale xy\nset format "10^{%T}"\nset xlabel "triangles"\n'
              'set grid xtics lt 1 lw 1 lc rgb "#CCCCCC"\nset key inside top right vertical\n'
              'set ylabel "distance / diagonal"\n'
              f"set multiplot layout 1,{len(shown)}\n")
    for mesh in shown:
        named = {}
        for method, label in tables.METHODS.items():
            points = [(r["triangles"], r["hausdorff_rel"]) for r in raw.rows("quality", mesh=mesh)
                      if r["method"] == method]
            if points:
                named[label] = sorted(points)
        data, plot = curves(named)
        script += f"set title {quoted(mesh_name(mesh))}\n{data}plot {plot}\n"
    draw(path, 460 * len(shown), 400, script + "unset multiplot\n")


def extraction_rate(raw, path):
    def points(family):
        return sorted({(r["triangles"], 1e-6 * r["items_per_second"])
                       for r in raw.google("query", family)})
    data, plot = curves({"uniform cuts": points("BM_WarmUniform"),
                         "boxes at full resolution": points("BM_WarmBox")})
    draw(path, 640, 380, 'set logscale x\nset format x "10^{%T}"\nset yrange [0:*]\n'
         'set xlabel "triangles of the answer"\nset ylabel "million triangles a second"\n'
         f"{data}plot {plot}\n")


def regions(raw, path):
    dense = max(r["object_triangles"] for r in raw.rows("regions"))
    rows = {}
    for r in raw.rows("regions", object_triangles=dense):
        rows.setdefault(r["query"], {})[r["method"]] = r
    both = {query: pair for query, pair in rows.items()
            if len(pair) == 2 and "whole" not in query}

    def ms(method, key):
        return [1e3 * pair[method][key] for pair in both.values()]
    data, width = bars({"mtdb, cold": ms("mtdb", "cold_seconds"),
                        "mtdb, warm": ms("mtdb", "warm_seconds"),
                        "all loaded, cold": ms("naive", "cold_seconds"),
                        "all loaded, warm": ms("naive", "warm_seconds")}, list(both),
                       colours=PAIRS)
    draw(path, 720, 400, width + 'set logscale y\nset ylabel "milliseconds"\n'
         f"set title {quoted('One region of ' + size_name(dense) + ' triangles')}\n" + data)


def size(raw, path):
    rows = raw.rows("size")
    named = {"mtdb, all levels": [r["file_bits_per_vertex"] for r in rows]}
    for packed, label in (("draco_level_10", "Draco 10, one level"),
                          ("zstd_level_19", "zstd -19 of the PLY")):
        named[label] = [r[packed]["bits_per_vertex"] for r in rows]
    data, width = bars(named, [mesh_name(r["mesh"]) for r in rows], tilt=True)
    draw(path, 860, 440, width + 'set yrange [0:*]\nset ylabel "bits per vertex"\n'
         'set rmargin 8\n' + data)


def sessions(raw, path):
    """Of the sweep, and of the cameras on the largest object."""
    rows = raw.rows("session", experiment="sweep")
    cameras = raw.rows("session", experiment="camera")
    largest = max(row["object_triangles"] for row in cameras)
    rows += [row for row in cameras if row["object_triangles"] == largest]
    labels = [row["experiment"] if row["experiment"] == "sweep"
              else f"{row['path']}, {row['threshold']}" for row in rows]
    data, width = bars({"a cut from scratch": [row["scratch_ms"] for row in rows],
                        "an update": [row["update_ms"] for row in rows]}, labels, tilt=True)
    draw(path, 760, 420, width + 'set logscale y\nset rmargin 8\n'
         'set ylabel "milliseconds a frame"\n' + data)


def rounds(raw, path):
    """The distance from the last mesh over what was received, of the largest object."""
    rows = raw.rows("session", experiment="rounds")
    largest = max(row["object_triangles"] for row in rows)
    rows = [row for row in rows if row["object_triangles"] == largest]
    points = [(row["bytes"], row["distance_of_diagonal"]) for row in rows
              if row["distance_of_diagonal"] > 0]
    end = max(row["bytes"] for row in rows)
    data, plot = curves({"mtdb, round by round": sorted(points)} if points else {})
    low, high = (f((y for _, y in points), default=y) for f, y in ((min, 1e-6), (max, 1e-1)))
    ends = block("end", [(end, low), (end, high)])
    draco = block("draco", [(rows[0]["draco_bytes"], low), (rows[0]["draco_bytes"], high)])
    draw(path, 640, 380, 'set logscale xy\nset format "10^{%T}"\n'
         'set xlabel "bytes received"\nset ylabel "distance / diagonal"\n' + data + ends + draco +
         f'plot {plot + ", " if points else ""}'
         f'$end with lines lw 2 dt 2 lc rgb "{COLOURS[0]}" title "mtdb has all", '
         f'$draco with lines lw 2 dt 2 lc rgb "{COLOURS[1]}" title "Draco has all"\n')


PLOTS = {f.__name__: f for f in (error_over_triangles, extraction_rate, regions, size, sessions,
                                 rounds)}
