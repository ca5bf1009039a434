// SPDX-License-Identifier: Apache-2.0
// Who reads an object again and again while it is replaced, renamed, removed or moved gets the one
// or the other, whole, or an error.
//
// Parameters of a step: of (which object); from (packed, mesh or store: whom it is read from);
// change (the act that comes meanwhile, with its own parameters); error (of the diagonal).
#include <filesystem>

#include "tests/everything/ways.h"

namespace mtdb::everything {

namespace fs = std::filesystem;

namespace {

constexpr int kReads = 8;
// mtdb, where files go, the verb, the place, options: an error is one that mtdb tells.
constexpr const char* kScript = R"(out=$1 verb=$2 place=$3; shift 3
for i in 0 1 2 3 4 5 6 7; do
  "$0" "$verb" "$place" "$out$i.ply" "$@" >&2 || [ $? = 1 ] || exit 9
done)";

// Empty: there is none of that name.
std::string MeshNow(World& world, int64_t store, const std::string& name,
                    const std::string& error) {
  if (!world.Store(store).model.objects.contains(name)) return "";
  const std::string out = world.Folder("out/beside.ply");
  const Ran ran =
      world.Mtdb({"extract", world.Store(store).path, out, "--name=" + name, "--error=" + error});
  if (!ran.ok()) world.ErrorFault("beside: refused", ran.err);
  std::string bytes = ReadText(out);
  fs::remove(out);
  return bytes;
}

}  // namespace

void BesideAct(World& world, const Step& step) {
  const int64_t store = step.Int("store", 0);
  const StoreModel& model = world.Store(store).model;
  const std::string change = step.Text("change", "rename");
  if (model.objects.empty() || change == step.act || ActOf(change) == nullptr) return;
  auto object = model.objects.begin();
  std::advance(object, static_cast<size_t>(step.Int("of", 0)) % model.objects.size());
  const std::string name = object->first;
  const std::string error = NumberText(100 * step.Number("error", 0)) + "%";
  const std::string before = MeshNow(world, store, name, error);

  const Asked asked{&world, store, name, nullptr, nullptr, &step};
  const std::string from = step.Text("from", "packed");
  Arguments read{"/bin/sh", "-c", kScript, world.options().mtdb, world.Folder("out/read")};
  if (from == "store") {
    read.insert(read.end(), {"extract", world.Store(store).path, "--name=" + name});
  } else if (from == "mesh") {
    read.insert(read.end(), {"fetch", Serving(asked)->url() + ObjectPath(asked), "--timeout=900"});
  } else {
    const std::string url = Serving(asked)->url() + ObjectPath(asked) + "/packed";
    read.insert(read.end(), {"extract", url, "--name=" + name});
  }
  read.push_back("--error=" + error);
  Child reader(read, world.scratch());
  Step inner = step;
  inner.act = change;
  ActOf(change)(world, inner);
  const Ran ran = world.Checked(reader.Wait(), "mtdb beside " + change);
  if (!ran.ok()) world.ErrorFault("beside: a reader fails without an error", ran.err);
  if (world.stopped()) return;
  const std::string after = MeshNow(world, store, name, error);
  for (int i = 0; i < kReads; ++i) {
    const std::string file = world.Folder("out/read" + std::to_string(i) + ".ply");
    const std::string got = ReadText(file);
    fs::remove(file);
    ++world.counts().answers;
    if (got.empty() || got == before || got == after) continue;
    world.Fault("beside: neither what was there nor what is there now",
                CommandLine(read) + ": " + std::to_string(got.size()) + " bytes of " +
                    std::to_string(before.size()) + " or " + std::to_string(after.size()));
  }
}

}  // namespace mtdb::everything
