// SPDX-License-Identifier: Apache-2.0
// Acts that write what is no mesh: pictures, and packed files where a store is.
#include <filesystem>
#include <map>

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
      arguments.insert(arguments.end(), {"--allow-source", "https://example.org"});
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

}  // namespace mtdb::everything
