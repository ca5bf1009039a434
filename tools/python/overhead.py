#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""What Python costs over C++: extracts a mesh of some 100,000 triangles from a warm cache, through the
package, and by the same calls of the library (which are C++). Prints both, and the overhead.

    PYTHONPATH=tools/python MTDB_LIBRARY=build/tools/libmtdb.so tools/python/overhead.py

--json prints one JSON object instead; --rounds N extracts N times (default 200).
"""
from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from typing import Callable

import mtdb
import numpy as np
from mtdb import _library as L

TRIANGLES = 100_000


def make_store(path: str) -> None:
    side = 400
    y, x = (a.ravel() for a in np.mgrid[0:side, 0:side])
    z = 9 * np.sin(0.03 * x) * np.cos(0.05 * y) + np.random.default_rng(1).random(side * side)
    a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    b = np.concatenate([np.stack([a, a + 1, a + side + 1], 1), np.stack([a, a + side + 1, a + side], 1)])
    mtdb.open(path, create=True).ingest(np.stack([x, y, z], 1), b, name="a")


def timed(work: Callable[[], object]) -> float:
    begin = time.thread_time()
    work()
    return time.thread_time() - begin


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--rounds", type=int, default=200, help="how often each is timed (200)")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = folder + "/a.mtdb"
        make_store(path)
        surface = mtdb.open(path).open_object(threads=1)
        # An accuracy that gives so many triangles.
        low, high = 0.0, surface.error_max
        for _ in range(30):
            error = (low + high) / 2
            count = len(surface.extract(error=error).faces)
            low, high = (error, high) if count > TRIANGLES else (low, error)
        text = ('{"threshold": %r}' % high).encode()
        query = L.Handle("query", "create_query", surface._handle, text)
        nothing = {"threshold": "coarsest", "clip": True,
                   "region": {"sphere": {"centre": [1e9, 1e9, 1e9], "radius": 1}}}

        def library(asked: L.Handle) -> None:
            cut = L.Handle("cut", "select", surface._handle, asked, None)
            L.Handle("mesh", "get_cut_mesh", cut, None)

        empty = surface._query(json.dumps(nothing))
        works: dict[str, Callable[[], object]] = {
            "library": lambda: library(query),
            "package": lambda: surface.extract(error=high),
            # A mesh without triangles: what is left is what Python does around the calls.
            "library, empty mesh": lambda: library(empty),
            "package, empty mesh": lambda: surface.extract(nothing),
        }
        costs: dict[str, list[float]] = {name: [] for name in works}
        for _ in range(arguments.rounds):  # in turn, so that others on the machine disturb all alike
            for name, work in works.items():
                costs[name].append(timed(work))
        best = {name: 1e6 * min(values) for name, values in costs.items()}
        triangles = len(surface.extract(error=high).faces)
        around = best["package, empty mesh"] - best["library, empty mesh"]
        if arguments.json:
            print(json.dumps({"triangles": triangles, "rounds": arguments.rounds,
                              "library_us": best["library"], "package_us": best["package"],
                              "python_us": around}))
            return
        print(f"{triangles} triangles, best of {arguments.rounds}, microseconds of one processor")
        for name in costs:
            print(f"  {name:20} {best[name]:9.1f}  (median {1e6 * statistics.median(costs[name]):.1f})")
        print(f"  Python adds {around:.1f}: {100 * around / best['library']:.2f} %; measured whole: "
              f"{100 * (best['package'] / best['library'] - 1):.2f} %")


if __name__ == "__main__":
    main()
