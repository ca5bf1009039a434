# SPDX-License-Identifier: Apache-2.0
"""What the campaigns faults and kills share: a small world of stores, its acts, and what must hold after each."""
import argparse
import json
import os
import pathlib
import shutil
import signal
import subprocess
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]


class Outcome:
    def __init__(self, status, out, err):
        self.signal = -status if status < 0 else 0
        self.status = status
        self.out = out
        self.err = err


class World:
    """A folder with meshes, what their stores must hold, and the program."""

    def __init__(self, build):
        self.mtdb = str(build / "tools/mtdb")
        self.library = str(build / "tests/libmtdb_faults.so")
        # AddressSanitizer wants to be loaded before all others.
        linked = subprocess.run(["ldd", self.mtdb], capture_output=True, text=True).stdout.split()
        self.preloaded = " ".join([w for w in linked if "/libasan." in w] + [str(self.library)])
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="mtdb-campaign-"))
        self.place = self.folder / "place"  # all that an act may touch
        self.base = self.folder / "base"
        self.base.mkdir()
        for name, seed in (("kept", 1), ("fresh", 2)):
            self.ok("generate", "sculpture", self.mesh(name), "--triangles", "3000", "--seed", str(seed))
        self.ok("ingest", self.mesh("fresh"), self.base / "store.mtdb", "--quiet")
        self.ok("ingest", self.mesh("kept"), self.base / "store.mtdb", "--quiet")
        self.digests = self.held(self.base / "store.mtdb")
        self.ok("remove", self.base / "store.mtdb", "fresh")
        self.reset()
        self.files = {}
        for act in ACTS.values():
            if act.output:
                self.ok(*self.command(act))
                self.files[act.output] = (self.place / act.output).read_bytes()
                self.reset()

    def mesh(self, name):
        return self.folder / (name + ".ply")

    def store(self):
        return self.place / "store.mtdb"

    def reset(self, with_fresh=False):
        shutil.rmtree(self.place, ignore_errors=True)
        shutil.copytree(self.base, self.place)
        (self.place / "tmp").mkdir()
        if with_fresh:
            self.ok("ingest", self.mesh("fresh"), self.store(), "--quiet")

    def command(self, act, *more):
        return [str(word) for word in act.words(self)] + list(more)

    def start(self, words, fault="", at=0, count=None):
        environment = dict(os.environ)
        if fault or count:
            environment.update(LD_PRELOAD=self.preloaded, MTDB_FAULT_UNDER=str(self.place), MTDB_FAULT=fault,
                               MTDB_FAULT_AT=str(at), MTDB_FAULT_COUNT=str(count or ""))
        return subprocess.Popen([self.mtdb, *map(str, words)], env=environment, stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, text=True, errors="replace")

    @staticmethod
    def finish(process, seconds=120):
        try:
            out, err = process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            process.kill()
            out, err = process.communicate()
            return Outcome(-signal.SIGALRM, out, err)  # stands for: it hung
        return Outcome(process.returncode, out, err)

    def run(self, words, **fault):
        return self.finish(self.start(words, **fault))

    def ok(self, *words):
        outcome = self.run(words)
        if outcome.status != 0:
            raise Wrong(f"{' '.join(map(str, words))}: status {outcome.status}: {outcome.err.strip()}")
        return outcome.out

    def held(self, store):
        """Object name -> digest."""
        if not store.exists():
            return {}
        outcome = self.run(["info", store, "--json"])
        if "nothing was stored in it yet" in outcome.err:
            return {}
        objects = json.loads(self.ok("info", store, "--json"))["objects"]
        return {o["object"]: o["digest"] for o in objects}

    def check_store(self, must, may):
        """The store has all objects of `must`, no others than `may` beside them, whole and undamaged."""
        held = self.held(self.store())
        for name in must:
            if name not in held:
                raise Wrong(f"object {name} is lost; the store holds {sorted(held)}")
        for name, digest in held.items():
            if name not in must and name not in may:
                raise Wrong(f"object {name} should not be there")
            if digest != self.digests[name]:
                raise Wrong(f"object {name} has another digest than when it is ingested undisturbed")
        if held:
            self.ok("verify", self.store(), "--level", "full")
        return held

    def check_files(self, allowed):
        """No file but the store, its lock and `allowed` (a predicate of the name)."""
        for path in self.place.rglob("*"):
            name = path.name
            if path.is_dir() or name in ("store.mtdb", "store.mtdb-lock") or allowed(name):
                continue
            raise Wrong(f"{name} is left behind")


class Wrong(Exception):
    pass


class Act:
    """One run of the program in the world, and what must be so afterwards, whether it ended well or not."""

    def __init__(self, words, with_fresh=False, makes=(), removes=(), output=None, fresh_store=False,
                 partial=False):
        self.words = words
        self.with_fresh = with_fresh    # the store has `fresh` before
        self.makes = set(makes)         # objects that are there after success
        self.removes = set(removes)     # objects that are gone after success
        self.output = output            # a file that is there, with the right bytes, after success
        self.fresh_store = fresh_store  # there is no store before
        self.partial = partial          # when killed it may leave a new store that has not its name yet

    def before(self, world):
        world.reset(self.with_fresh)
        if self.fresh_store:
            world.store().unlink()

    def check(self, world, succeeded, died):
        had = set() if self.fresh_store else {"kept"} | ({"fresh"} if self.with_fresh else set())
        must = (had | self.makes) - self.removes if succeeded else had - self.removes
        may = set() if succeeded else self.makes | self.removes
        held = world.check_store(must, may)
        journal = bool(self.makes) and not succeeded
        output = world.place / self.output if self.output else None
        partial = self.partial and died and not succeeded
        world.check_files(lambda name: (journal and name.endswith(".journal")) or (output and name == output.name) or
                          (partial and name.startswith("store.mtdb.partial")))
        if output and (succeeded or output.exists()):
            if output.read_bytes() != world.files[self.output]:
                raise Wrong(f"{self.output} has other bytes than when nothing disturbs")
        return held

    def again(self, world):
        """What the message says helps: the same once more, then all is well."""
        # What `list` finds finished, it removes; of the rest it tells.
        listed = world.run(["list", world.store(), "--tmp", world.place / "tmp", "--json"])
        offered = len(json.loads(listed.out).get("journals", [])) if listed.status == 0 else 0
        left = len(list(world.place.rglob("*.journal")))
        if offered != left:
            raise Wrong(f"{left} journals are left, list tells of {offered}")
        held = world.held(world.store())
        if self.makes <= set(held) and left:
            raise Wrong("list offers to go on with what is published")
        if self.makes and not self.makes <= set(held):
            world.ok(*world.command(self, "--resume"))
        elif self.removes and not self.removes & set(held):
            pass
        elif not self.makes:
            world.ok(*world.command(self))
        self.check(world, True, False)


ACTS = {
    "ingest": Act(lambda w: ["ingest", w.mesh("fresh"), w.store(), "--quiet", "--tmp", w.place / "tmp"],
                  makes=["fresh"]),
    "ingest-first": Act(lambda w: ["ingest", w.mesh("fresh"), w.store(), "--quiet", "--tmp", w.place / "tmp"],
                        makes=["fresh"], fresh_store=True),
    "remove": Act(lambda w: ["remove", w.store(), "fresh"], with_fresh=True, removes=["fresh"]),
    "extract": Act(lambda w: ["extract", w.store(), w.place / "out.ply", "--name", "kept", "--error", "1%"],
                   output="out.ply"),
    "extract-glb": Act(lambda w: ["extract", w.store(), w.place / "out.glb", "--name", "kept"], output="out.glb"),
    "render": Act(lambda w: ["render", w.store(), w.place / "out.png", "--name", "kept", "--size", "64x64"],
                  output="out.png"),
    "pack": Act(lambda w: ["pack", w.store(), w.place / "out.mtdbp", "--name", "kept"], output="out.mtdbp"),
    "compact": Act(lambda w: ["compact", w.store(), "--json"], partial=True),
    "list": Act(lambda w: ["list", w.store()]),
    "probe": Act(lambda w: ["probe", w.store(), "--name", "kept", "--point", "0,0,0"]),
    "verify": Act(lambda w: ["verify", w.store(), "--level", "global"]),
}


def one_line(text):
    lines = [line for line in text.splitlines() if line]
    return len(lines) == 1 and lines[0].startswith("mtdb: ")


def arguments(description, count, what):
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--build", type=pathlib.Path, default=ROOT / "build-test", help="the build folder (build-test)")
    parser.add_argument("--count", type=int, default=count, help=f"{what} ({count})")
    parser.add_argument("--seed", type=int, default=1, help="which of them (1)")
    parser.add_argument("--act", action="append", choices=sorted(ACTS), help="these acts only; may be repeated")
    return parser


def summary(title, done, wrongs):
    print(f"{title}: {done} done, {len(wrongs)} wrong")
    for what, example in sorted(wrongs.items()):
        print(f"  {what}\n    e.g. {example}")
    return 1 if wrongs else 0
