// SPDX-License-Identifier: Apache-2.0
// Acts that write trees of tiles, and hold them against their objects.
#include <filesystem>
#include <map>
#include <utility>

#include "tests/everything/world.h"

namespace mtdb::everything {

namespace fs = std::filesystem;

namespace {

using Files = std::map<std::string, std::string>;  // path from the folder -> bytes

Files FilesOf(const std::string& folder) {
  Files files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    files[fs::relative(entry.path(), folder).string()] = ReadText(entry.path().string());
  }
  return files;
}

// A tile that is gone, or another one, is noticed.
void Harm(World& world, const Step& step, const Arguments& verify, const std::string& folder) {
  Files tiles = FilesOf(folder);
  // Not what says which files there are, and is for people only.
  std::erase_if(tiles, [](const auto& file) {
    return file.first.ends_with(".json") || file.first.ends_with("info") || file.second.size() < 2;
  });
  if (tiles.empty()) return;
  const auto which = static_cast<size_t>(step.Int("harm", 0)) % tiles.size();
  const auto& [name, bytes] = *std::next(tiles.begin(), static_cast<ptrdiff_t>(which));
  const std::string path = folder + "/" + name;
  if (step.Int("harm", 0) % 2 == 0) {
    fs::remove(path);
  } else {
    WriteText(path, bytes.substr(0, bytes.size() / 2));
  }
  const Ran ran = world.Mtdb(verify);
  if (ran.ok() || ran.exit_code != 1) world.Fault("tile: verify misses a harmed tile", path);
}

Arguments HowTo(const Step& step, const std::string& name) {
  Arguments how{"--name", name,
                "--tile-triangles=" + std::to_string(step.Int("triangles", 50'000))};
  if (step.Flag("segments")) {
    how.insert(how.end(),
               {"--as", "neuroglancer", "--bits=" + std::to_string(step.Int("bits", 16))});
    if (step.Flag("sharded")) how.push_back("--sharded");
  } else if (step.Flag("at")) {
    how.push_back("--at=11.5,48.1,520");
  }
  return how;
}

void TileObject(World& world, const Step& step, const std::string& store, const std::string& packed,
                const std::string& name) {
  const Arguments how = HowTo(step, name);
  const std::string folders[2]{world.Folder("out/tiles"), world.Folder("out/tiles_again")};
  for (const std::string& folder : folders) {
    const bool first = &folder == &folders[0];
    Arguments arguments{"tile", first ? store : packed, folder,
                        "--threads=" + std::string(first ? "1" : "3")};
    arguments.insert(arguments.end(), how.begin(), how.end());
    Ran ran = first ? world.Mtdb(arguments) : RunOrKill(world, step, arguments);
    if (ran.killed) ran = world.Mtdb(arguments);
    if (!ran.ok()) return world.ErrorFault("tile: refused", ran.err);
  }
  const Files files = FilesOf(folders[0]);
  Files again = FilesOf(folders[1]);
  std::erase_if(again, [](const auto& file) { return file.first.ends_with(".tmp"); });
  if (files != again) world.Fault("tile: other bytes of the packed file or after a kill", name);
  if (!files.contains(step.Flag("segments") ? "info" : "tileset.json")) {
    world.Fault("tile: nothing that makes the tree known", name);
  }
  const Arguments verify{"verify", store, "--name", name, "--tiles", folders[0]};
  ++world.counts().answers;
  const Ran ran = world.Mtdb(verify);
  if (!ran.ok()) world.Fault("tile: verify refuses it", ran.out + ran.err);
  Harm(world, step, verify, folders[0]);
}

}  // namespace

void TileAct(World& world, const Step& step) {
  StorePlace& place = world.Store(step.Int("store", 0));
  if (place.model.objects.empty()) return;
  const std::string packed = world.Folder("out/tiled.mtdbp");
  const Ran ran = world.Mtdb({"pack", place.path, packed});
  if (!ran.ok()) return world.ErrorFault("pack: refused", ran.err);
  for (const auto& [name, object] : place.model.objects) {
    ++world.counts().acts;
    TileObject(world, step, place.path, packed, name);
    for (const char* folder : {"out/tiles", "out/tiles_again"})
      fs::remove_all(world.Folder(folder));
    if (world.stopped()) break;
  }
  fs::remove(packed);
}

}  // namespace mtdb::everything
