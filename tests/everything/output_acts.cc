// SPDX-License-Identifier: Apache-2.0
// Acts that write what is no mesh: pictures, and packed files where a store is; outputs that are
// aimed at what must be kept, and input that never ends.
#include <filesystem>
#include <map>
#include <sys/stat.h>

#include "tests/everything/world.h"

namespace mtdb::everything {

namespace fs = std::filesystem;

namespace {

// Two pictures of one question, of the store and of its packed file, are equal.
void Draw(World& world, const std::string& store, const std::string& packed,
          const std::string& name, const Arguments& how) {
  std::string pictures[2];
  for (size_t i = 0; i < 2; ++i) {
    const std::string out = world.Folder("out/picture.png");
    Arguments arguments{"render", i == 0 ? store : packed, out, "--name", name, "--size", "48x36"};
    arguments.insert(arguments.end(), how.begin(), how.end());
    ++world.counts().answers;
    const Ran ran = world.Mtdb(arguments);
    if (!ran.ok()) return world.ErrorFault("picture: refused", ran.err);
    pictures[i] = ReadText(out);
    fs::remove(out);
    if (!pictures[i].starts_with("\x89PNG")) {
      return world.Fault("picture: no PNG", CommandLine(arguments));
    }
  }
  if (pictures[0] != pictures[1]) {
    world.Fault("picture: another one of the packed file", CommandLine(how));
  }
}

}  // namespace

void PictureAct(World& world, const Step& step) {
  StorePlace& place = world.Store(step.Int("store", 0));
  if (place.model.objects.empty()) return;
  const std::string packed = world.Folder("out/picture.mtdbp");
  const Ran ran = world.Mtdb({"pack", place.path, packed});
  if (!ran.ok()) return world.ErrorFault("pack: refused", ran.err);
  for (const auto& [name, object] : place.model.objects) {
    ++world.counts().acts;
    Arguments how{"--view", step.Text("view", "auto"),
                  "--error=" + NumberText(step.Number("error", 0.01) * object->diagonal)};
    for (const char* flag : {"draft", "smooth", "wireframe", "scale-bar"}) {
      if (step.Flag(flag)) how.push_back(std::string("--") + flag);
    }
    std::vector<std::string> colours{"none", "normal"};
    const auto& attributes = object->layout.attributes;
    for (size_t i = 0; i < attributes.size() && i < 3; ++i) {
      colours.push_back("attribute:" + attributes[i].name);
    }
    for (const std::string& colour : colours) {
      Arguments one = how;
      one.push_back("--colour=" + colour);
      Draw(world, place.path, packed, name, one);
    }
    const Ran wrong = world.Mtdb({"render", place.path, world.Folder("out/wrong.png"), "--name",
                                  name, "--size", "48x36", "--colour=attribute:no such thing"});
    if (wrong.ok() || fs::exists(world.Folder("out/wrong.png"))) {
      world.Fault("picture: an attribute that is not there", wrong.out);
    }
  }
  fs::remove(packed);
}

void PageAct(World& world, const Step& step) {
  ++world.counts().acts;
  const std::string folder = world.Folder("out/www");
  std::map<std::string, std::string> files[2];
  for (auto& found : files) {
    Arguments arguments{"view", "--write-page", folder};
    if (step.Flag("source")) {
      arguments.insert(arguments.end(), {"--allowed-source", "https://example.org"});
    }
    const Ran ran = world.Mtdb(arguments);
    if (!ran.ok()) return world.ErrorFault("page: refused", ran.err);
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
      if (entry.is_regular_file()) found[entry.path().string()] = ReadText(entry.path().string());
    }
    // Over what is half there, or of another version, too.
    if (&found != &files[0]) continue;
    for (const auto& [path, bytes] : found) {
      if (step.Int("seed", 0) % 3 == 1) WriteText(path, bytes.substr(0, bytes.size() / 2));
      if (step.Int("seed", 0) % 3 == 2) fs::remove(path);
    }
  }
  if (files[0] != files[1] || !files[0].contains(folder + "/index.html")) {
    world.Fault("page: writes something else the second time", folder);
  }
  const bool says =
      files[0][folder + "/index.html"].find("https://example.org") != std::string::npos;
  if (says != step.Flag("source")) world.Fault("page: reads from somewhere else", folder);
  fs::remove_all(folder);
}

void PackOntoAct(World& world, const Step& step) {
  const int64_t from = step.Int("store", 0), to = step.Flag("itself") ? from : from + 1;
  StorePlace &source = world.Store(from), &target = world.Store(to);
  if (source.model.objects.empty() || !HasStore(target)) return;
  ++world.counts().acts;
  const std::string before = ReadText(target.path);
  const Ran ran = world.Mtdb({"pack", source.path, world.PathOf(to, step.Text("by", "plain"))});
  if (ran.ok()) {
    world.Fault("pack: replaces a store", ran.out);
    return world.Stop();
  }
  if (ReadText(target.path) != before) world.Fault("pack: changes a store", target.path);
  CheckLeftovers(world);
  CheckStore(world, to, "fast");
}

// A link to what must be kept is where an output goes.
void AimAct(World& world, const Step& step) {
  StorePlace& place = world.Store(step.Int("store", 0));
  if (place.model.objects.empty()) return;
  ++world.counts().acts;
  const std::string& name = place.model.objects.begin()->first;
  const std::string packed = world.Folder("out/kept.mtdbp");
  const Ran made = world.Mtdb({"pack", place.path, packed});
  if (!made.ok()) return world.ErrorFault("pack: refused", made.err);
  const std::string kept = step.Flag("packed") ? packed : place.path;
  const std::string before = ReadText(kept);
  const std::string format = step.Text("output", "ply");
  const bool picture = step.Flag("picture");
  const std::string link = world.Folder(std::string("out/aimed.") + (picture ? "png" : format));
  fs::remove(link);
  if (step.Text("by", "symlink") == "hardlink") {
    fs::create_hard_link(kept, link);
  } else {
    fs::create_symlink(kept, link);
  }
  Arguments arguments{picture ? "render" : "extract", place.path, link, "--name", name};
  if (picture) arguments.insert(arguments.end(), {"--size", "48x36", "--draft"});
  if (step.Flag("generate")) arguments = {"generate", "sculpture", link, "--triangles", "100"};
  const Ran ran = world.Mtdb(arguments);
  if (ran.ok()) world.Fault("aim: not refused", CommandLine(arguments));
  if (ReadText(kept) != before) {
    world.Fault("aim: what is kept was changed", CommandLine(arguments));
    world.Stop();
  }
  fs::remove(link);
  fs::remove(packed);
  CheckLeftovers(world);
  CheckStore(world, step.Int("store", 0), "fast");
}

// Standard input never ends: it is refused when it is no mesh, and else ends with a limit or a
// signal. Nothing is stored, and nothing left.
void PourAct(World& world, const Step& step) {
  StorePlace& place = world.Store(step.Int("store", 0));
  ++world.counts().acts;
  const std::string stream = step.Text("stream", "zeros");
  const std::string script = stream == "zeros"   ? "exec cat /dev/zero"
                             : stream == "words" ? "exec yes nothing"
                             : stream == "mesh"  ? "exec yes v 1 2 3"
                             : stream == "late"  ? "while echo v 1 2 3; do sleep 0.05; done"
                                                 : "exec sleep 1000";
  const bool ends = stream == "zeros" || stream == "words" || stream == "mesh";
  const bool is_obj = stream == "mesh" || !ends;
  const std::string fifo = world.scratch() + "/poured";
  fs::remove(fifo);
  if (::mkfifo(fifo.c_str(), 0600) != 0) return;
  const Child pouring({"/bin/bash", "-c", "exec >'" + fifo + "' 2>/dev/null; " + script},
                      world.scratch());
  RunOptions run;
  run.input = fifo;
  run.folder = world.Folder("inputs");
  Arguments arguments{world.options().mtdb,
                      "ingest",
                      "-",
                      place.path,
                      "--name",
                      "poured",
                      "--quiet",
                      "--max-tmp",
                      "8M",
                      "--format",
                      is_obj ? "obj" : step.Text("format", "stl")};
  // What only comes slowly is told to stop, when it has surely begun.
  if (!ends)
    arguments.insert(arguments.begin(), {"/usr/bin/timeout", "--preserve-status", "-s",
                                         step.Text("signal", "TERM"), "3"});
  const Ran ran = world.Checked(Run(arguments, world.scratch(), run), "mtdb ingest");
  fs::remove(fifo);
  if (ran.ok()) world.Fault("pour: stored", stream);
  if (ran.err.find("mtdb: ") == std::string::npos) world.Fault("pour: says nothing", stream);
  CheckLeftovers(world);
  if (HasStore(place)) CheckStore(world, step.Int("store", 0), "fast");
}

}  // namespace mtdb::everything
