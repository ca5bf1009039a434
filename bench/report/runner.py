# SPDX-License-Identifier: Apache-2.0
"""Runs a program and notes what it took, and what machine and sources these are.

A step is one JSON file in the folder of results:

  step, command    its name, and the programs that it ran
  ok, error        whether all of them ended well, else why
  context          machine, commit, compiler, peers: what the figures depend on
  settings         what the figures depend on besides: the sizes of the run
  load             of the machine before the step
  wall_seconds, cpu_seconds, peak_rss_bytes   of all its programs
  rows             what they measured: a list of objects

A step that is there for the same context and settings, and ended well, is not run again.
"""
import ctypes
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
PEERS = {"CGAL": "libcgal-dev", "meshoptimizer": "libmeshoptimizer-dev", "Draco": "libdraco-dev",
         "zstd": "libzstd-dev", "LMDB": "liblmdb-dev", "Google Benchmark": "libbenchmark-dev"}
# What the page is made of does not change what is measured.
NOT_MEASURED = [":(exclude)docs", ":(exclude)*.md", ":(exclude)bench/report/page.md.in",
                ":(exclude)bench/report/report.py", ":(exclude)bench/report/tables.py",
                ":(exclude)bench/report/plots.py", ":(exclude)bench/report/raw.py",
                ":(exclude)bench/report/published.json", ":(exclude)tests"]


class Failed(Exception):
    """A program of a step failed; the message is for the page."""


class Unavailable(Exception):
    """What a step needs is not on this machine."""


def first_match(pattern, path, default="unknown"):
    try:
        found = re.search(pattern, pathlib.Path(path).read_text(), re.MULTILINE)
    except OSError:
        return default
    return found.group(1).strip() if found else default


def output_of(*command, default="unknown"):
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return default
    return done.stdout.strip()


def commit():
    name = output_of("git", "describe", "--always", "--abbrev=12")
    changed = subprocess.run(["git", "diff", "--quiet", "HEAD", "--", ".", *NOT_MEASURED],
                             cwd=ROOT, stderr=subprocess.DEVNULL).returncode
    return name + ("-dirty" if changed == 1 else "")


def context(build):
    compiler = first_match(r"^CMAKE_CXX_COMPILER:\w+=(.*)$", build / "CMakeCache.txt", "c++")
    build_type = first_match(r"^CMAKE_BUILD_TYPE:\w+=(.*)$", build / "CMakeCache.txt")
    memory_kb = int(first_match(r"^MemTotal:\s+(\d+) kB", "/proc/meminfo", "0"))
    return {
        "machine": {"cpu": first_match(r"^model name\s*:\s*(.*)$", "/proc/cpuinfo"),
                    "cores": len(os.sched_getaffinity(0)),
                    "memory_bytes": memory_kb * 1024,
                    "system": first_match(r'^PRETTY_NAME="(.*)"$', "/etc/os-release")},
        "commit": commit(),
        "compiler": output_of(compiler, "--version").split("\n")[0] + ", " + build_type,
        "peers": {name: output_of("dpkg-query", "-W", "-f=${Version}", package)
                  for name, package in PEERS.items()},
    }


def forget_file(path):
    """Drops a file from the system's cache, so that reading it is cold. Needs no rights."""
    with open(path, "rb") as file:
        os.fsync(file.fileno())
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def end_with_parent():
    """In a child: killed when tools/benchmark is, however that ends."""
    pr_set_pdeathsig = 1
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)


class Runner:
    def __init__(self, build, results, settings):
        self.build = build
        self.results = results
        self.settings = settings
        self.context = context(build)
        self.commands = []
        self.used = {}

    def run(self, *command, shown=None):
        """Runs a program to its end; raises Failed. Its standard output, and what it took. The page
        shows the command, or of it what is `shown`; nothing of an empty one."""
        command = [str(part) for part in command]
        shown = command if shown is None else [str(part) for part in shown]
        if shown:
            self.commands.append(" ".join(
                pathlib.Path(part).name if part.startswith("/") else part for part in shown))
        with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
            begin = time.monotonic()
            process = subprocess.Popen(command, stdout=out, stderr=err, cwd=ROOT,
                                       preexec_fn=end_with_parent)
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            used = {"wall_seconds": time.monotonic() - begin,
                    "cpu_seconds": usage.ru_utime + usage.ru_stime,
                    "peak_rss_bytes": usage.ru_maxrss * 1024}
            out.seek(0)
            err.seek(0)
            for key in ("wall_seconds", "cpu_seconds"):
                self.used[key] = self.used.get(key, 0) + used[key]
            self.used["peak_rss_bytes"] = max(self.used.get("peak_rss_bytes", 0),
                                              used["peak_rss_bytes"])
            if process.returncode != 0:
                last = (err.read().strip() or out.read().strip()).split("\n")[-1]
                how = (f"signal {-process.returncode}" if process.returncode < 0
                       else f"exit status {process.returncode}")
                raise Failed(f"{pathlib.Path(command[0]).name}: {how}: {last}")
            return out.read(), used

    def rows(self, program, *arguments):
        """The rows that a program of bench/ writes with --json FILE."""
        with tempfile.NamedTemporaryFile(suffix=".json") as file:
            self.run(self.build / "bench" / program, *arguments, "--json", file.name,
                     shown=[program, *arguments])
            return json.load(open(file.name))

    def google_rows(self, program, *arguments):
        """The rows of a Google Benchmark program: one a benchmark."""
        with tempfile.NamedTemporaryFile(suffix=".json") as file:
            self.run(self.build / "bench" / program, *arguments,
                     f"--benchmark_out={file.name}", "--benchmark_out_format=json",
                     shown=[program, *arguments])
            rows = json.load(open(file.name))["benchmarks"]
        for row in rows:
            if row.get("error_occurred"):
                raise Failed(f"{program}: {row['name']}: {row['error_message']}")
        return rows

    def mtdb(self, *arguments):
        """What a verb prints with --json, and what the process took."""
        shown = [] if arguments[0] in ("list", "info") else ["mtdb", *arguments]
        out, used = self.run(self.build / "tools" / "mtdb", *arguments, "--json", shown=shown)
        return json.loads(out), used

    def path(self, name):
        return self.results / f"{name}.json"

    def kept(self, name):
        """The step as it was measured before, when that still holds."""
        try:
            step = json.loads(self.path(name).read_text())
        except (OSError, ValueError):
            return None
        same = step["context"] == self.context and step["settings"] == self.settings
        return step if same and step["ok"] else None

    def step(self, name, function, again):
        """Runs a step, unless its result is kept. False when it failed."""
        if not again and self.kept(name):
            print(f"{name}: kept", flush=True)
            return True
        print(f"{name} ... ", end="", flush=True)
        self.commands, self.used = [], {}
        step = {"step": name, "ok": True, "error": "", "context": self.context,
                "settings": self.settings, "load": os.getloadavg()[0]}
        try:
            step["rows"] = function(self)
        except (Failed, Unavailable, OSError) as error:
            step.update(ok=False, error=str(error).replace(str(ROOT) + "/", ""), rows=[])
            step["unavailable"] = isinstance(error, Unavailable)
        step["command"] = list(dict.fromkeys(self.commands))
        step.update(self.used)
        partial = self.path(name).with_suffix(".partial")
        partial.write_text(json.dumps(step, indent=1) + "\n")
        partial.replace(self.path(name))
        absent = step.get("unavailable", False)
        print(f"{step.get('wall_seconds', 0):.1f} s" if step["ok"]
              else ("not here: " if absent else "FAILED: ") + step["error"], flush=True)
        return step["ok"] or absent


def require_space(folder, size_bytes, what):
    free = shutil.disk_usage(folder).free
    if free < size_bytes:
        raise Failed(f"{folder}: {what} needs {size_bytes / 1e9:.1f} GB, "
                     f"but {free / 1e9:.1f} GB are free; make room, or link the folder elsewhere")
