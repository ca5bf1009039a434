// SPDX-License-Identifier: Apache-2.0
// The layers of mtdb hold: every #include of the project is read and held against the drawing
//
//     base <- files     {base, files} <- {codecs/mesh_file, store, query, builder}
//     base <- codecs    base <- store    {store, codecs} <- query    {store, codecs} <- builder
//     all <- tools, tests, bench
//
// where folders have rooms,
//
//     coding <- cluster    coding <- stream    mesh_file    raster_file    image_file
//     records <- pages <- lmdb    carriers <- pages    {records, carriers} <- packed    all <-
//     store fields <- cache <- cut <- answer <- moving    answer <- ask    fields <- json disk <-
//     holes <- measure <- decimate <- tiles <- {intake, write} <- rounds client <- request <-
//     tiles <- server    generate <- render    all <- cli, c
//
// and against the rules on who may see which library. What is private is in mtdb::internal. No room
// is larger than its reader can hold.
#include <algorithm>
#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <vector>

namespace mtdb::test {
namespace {

constexpr size_t kMaxLines = 800;
const std::set<std::string> kFolders{"store", "codecs", "query", "builder",
                                     "tools", "tests",  "bench"};

// By layer or room, the others that it may include.
const std::map<std::string, std::set<std::string>> kMayInclude{
    {"base", {}},
    {"files", {"base"}},
    {"codecs/coding", {"base"}},
    {"codecs/cluster", {"base", "codecs/coding"}},
    {"codecs/stream", {"base", "codecs/coding"}},
    {"codecs/mesh_file", {"base", "files"}},
    {"codecs/raster_file", {"base", "files"}},
    {"codecs/image_file", {"base"}},
    {"store/records", {"base"}},
    {"store/carriers", {"base", "files"}},
    {"store/pages", {"base", "files", "store/records", "store/carriers"}},
    {"store/lmdb", {"base", "files", "store/records", "store/carriers", "store/pages"}},
    {"store/packed", {"base", "files", "store/records", "store/carriers"}},
    {"store", {"base", "files", "store"}},
    {"query/fields", {"base", "store/records"}},
    {"query/cache", {"base", "files", "store/records", "codecs/cluster", "query/fields"}},
    {"query/cut", {"base", "store/records", "codecs/cluster", "query/fields", "query/cache"}},
    {"query/answer",
     {"base", "files", "store/records", "codecs/cluster", "query/fields", "query/cache",
      "query/cut"}},
    {"query/moving",
     {"base", "store/records", "codecs/cluster", "codecs/stream", "query/fields", "query/cache",
      "query/cut", "query/answer"}},
    {"query/ask",
     {"base", "store", "codecs/cluster", "query/fields", "query/cache", "query/cut",
      "query/answer"}},
    {"query/compare", {"base", "store/records", "query/fields", "query/answer", "query/ask"}},
    {"query/terrain",
     {"base", "store/records", "query/fields", "query/answer", "query/ask", "query/compare"}},
    {"query/json", {"base", "store/records", "query/fields"}},
    {"builder/disk", {"base", "files", "store/records"}},
    {"builder/holes", {"base", "store/records", "codecs/cluster", "builder/disk"}},
    {"builder/measure", {"base", "store/records", "builder/disk", "builder/holes"}},
    {"builder/decimate",
     {"base", "store/records", "codecs/cluster", "builder/disk", "builder/holes",
      "builder/measure"}},
    {"builder/tiles",
     {"base", "store/records", "builder/disk", "builder/holes", "builder/decimate"}},
    {"builder/intake",
     {"base", "store/records", "codecs/cluster", "builder/disk", "builder/tiles"}},
    {"builder/surface", {"base", "store/records", "builder/disk", "builder/intake"}},
    {"builder/write",
     {"base", "files", "store/records", "codecs/cluster", "codecs/image_file", "builder/disk",
      "builder/measure", "builder/decimate", "builder/tiles"}},
    {"builder/rounds", {"base", "files", "store/records", "codecs/cluster", "builder"}},
    {"tools/client", {"base", "codecs/stream"}},
    {"tools/request", {"base", "store", "query", "builder", "codecs/mesh_file", "tools/client"}},
    {"tools/generate", {"base", "files", "codecs/mesh_file"}},
    {"tools/render",
     {"base", "store", "codecs/image_file", "codecs/mesh_file", "query", "tools/generate"}},
    {"tools/tiles", {"base", "files", "store", "query", "codecs/mesh_file", "tools/request"}},
    {"tools/server",
     {"base", "files", "store", "codecs/mesh_file", "codecs/stream", "query", "tools/client",
      "tools/request", "tools/tiles", "tools/viewer"}},
    {"tools/viewer", {"codecs/stream"}},
    {"tools/gdal", {"base", "files", "codecs/mesh_file", "codecs/raster_file", "builder"}},
    {"tools/web", {"base", "store", "codecs/stream", "query", "tools/viewer"}},
    {"tools/cli",
     {"base", "files", "store", "codecs/cluster", "codecs/mesh_file", "codecs/raster_file", "query",
      "builder", "tools/client", "tools/gdal", "tools/request", "tools/generate", "tools/render",
      "tools/server", "tools/tiles"}},
    {"tools/c",
     {"base", "store", "codecs/mesh_file", "codecs/raster_file", "codecs/stream", "query",
      "builder", "tools/client", "tools/gdal", "tools/request", "tools/render", "tools/server"}},
    {"tools", {"base", "store", "query", "builder", "tools/c"}},  // the examples
};
// These may include all of them, and each other.
const std::set<std::string> kOnlookers{"tests", "bench"};

// Folders whose headers are for all, and whose rooms are not. A public header belongs to the room
// that has what it declares.
const std::set<std::string> kHalls{"store", "query", "builder"};
const std::map<std::string, std::set<std::string>> kPublicHeaders{
    {"store/records",
     {"check_report.h", "cluster_index.h", "cluster_source.h", "metres_of_unit.h", "object_name.h",
      "object_record.h", "object_writer.h", "texture_pages.h", "texture_tiles.h", "tiles_head.h"}},
    {"store/carriers", {"open_options.h", "range_reader.h"}},
    {"store/packed", {"packed_file.h"}},
    {"store", {"copy.h", "database.h", "verify_store.h"}},
    {"query/fields",
     {"camera.h", "extract_stats.h", "query.h", "query_control.h", "region.h", "threshold.h"}},
    {"query/cache", {"runtime_form.h"}},
    {"query/answer", {"cut.h", "surface.h"}},
    {"query/moving", {"session.h"}},
    {"query/ask", {"heights.h", "probe.h", "verify_object.h"}},
    {"query/compare", {"compare.h"}},
    {"query/terrain", {"height_change.h"}},
    {"query/json", {"query_from_json.h", "query_json.h"}},
    {"builder/disk", {"build_options.h"}},
    {"builder/intake", {"mesh_survey.h"}},
    {"builder/write", {"journal_info.h"}},
    {"builder/rounds", {"build.h"}},
};
// A room that is larger has two ideas; but for store/base, the words that all layers speak, each in
// a small file.
constexpr size_t kMostRoomLines = 4000, kMostRoomFiles = 30;
const std::set<std::string> kLargeRooms{"store/base"};

// By how an #include begins, the folders whose files may have it.
const std::map<std::string, std::set<std::string>> kLibraryUsers{
    {"lmdb", {"store/lmdb/", "tests/store/"}},
    {"curl/", {"store/carriers/http_"}},
    {"xxhash", {"store/base/"}},
    {"CGAL/", {"builder/", "tests/", "bench/"}},
    {"draco/", {"codecs/mesh_file/", "tools/tiles/neuroglancer/", "tests/", "bench/"}},
    {"zstd", {"codecs/cluster/", "builder/disk/squeeze", "tools/web/wasm/", "tests/", "bench/"}},
    {"zdict", {"codecs/cluster/", "tests/", "bench/"}},
    {"embree", {"tools/render/", "tests/", "bench/"}},
    {"png", {"codecs/image_file/", "tools/tiles/terrain_rgb/", "tests/"}},
    {"jpeglib", {"codecs/image_file/", "tests/"}},
    {"CLI/", {"tools/cli/", "bench/"}},
    {"nlohmann/",
     {"store/base/json.cc", "codecs/mesh_file/readers/gltf_document.h", "tests/", "bench/"}},
    {"boost/", {"tools/client/", "tools/server/", "tests/tools/"}},
    {"meshoptimizer", {"codecs/mesh_file/", "tools/tiles/three_d/", "tests/", "bench/"}},
    {"zlib",
     {"codecs/mesh_file/", "tools/server/internal/server_page", "tools/tiles/archive/", "tests/"}},
    {"gdal", {"tools/gdal/"}},
    {"cpl_", {"tools/gdal/"}},
    {"ogr_", {"tools/gdal/"}},
    {"benchmark/", {"bench/"}},
    {"catch2/", {"tests/"}},
};

// What reads and writes files, which base does not do.
const std::set<std::string> kFileHeaders{"fstream", "filesystem", "fcntl.h", "unistd.h"};

// "codecs/stream", "query/cut", ... Empty for what is not the project's.
std::string LayerOf(const std::string& path) {
  if (path.starts_with("store/base/")) return "base";
  if (path.starts_with("store/files/")) return "files";
  const size_t slash = path.find('/');
  const std::string folder = path.substr(0, slash);
  if (!kFolders.contains(folder) || folder == path) return "";
  const size_t second = path.find('/', slash + 1);
  if (second != std::string::npos) {
    return folder == "codecs" || folder == "tools" || kHalls.contains(folder)
               ? path.substr(0, second)
               : folder;
  }
  for (const auto& [room, headers] : kPublicHeaders) {
    if (room.starts_with(folder) && headers.contains(path.substr(slash + 1))) return room;
  }
  return folder;
}

// The folder that a reader has open: internal/ belongs to the one above it.
std::string RoomOf(const std::string& path) {
  const std::string folder = path.substr(0, path.rfind('/'));
  return folder.ends_with("/internal") ? folder.substr(0, folder.rfind('/')) : folder;
}

// Whether the room `layer` may include what the room `target` has: itself, a room that it names, or
// any of a folder that it names.
bool MayInclude(const std::set<std::string>& named, const std::string& layer,
                const std::string& target) {
  const std::string folder = target.substr(0, target.find('/'));
  return target == layer || named.contains(target) ||
         (kHalls.contains(folder) && named.contains(folder));
}

// "builder" for builder/tiles/x.h, "tools/server" for tools/server/http/x.h, "codecs" for
// codecs/coding/x.h; empty for a public header.
std::string OwnerOfInternal(const std::string& path) {
  if (path.starts_with("codecs/coding/")) return "codecs";
  const std::string folder = path.substr(0, path.find('/'));
  if (kHalls.contains(folder)) {
    const bool shared = path.starts_with("store/base/") || path.starts_with("store/files/");
    return shared || path.find('/', folder.size() + 1) == std::string::npos ? "" : folder;
  }
  const size_t room = path.find('/', folder.size() + 1);
  if (folder != "codecs" && !path.starts_with("tools/server/")) {
    const size_t at = path.find("/internal/");
    return at == std::string::npos ? "" : path.substr(0, at);
  }
  return room == std::string::npos || path.find('/', room + 1) == std::string::npos
             ? ""
             : path.substr(0, room);
}

// Of a layer or a room, for others.
bool IsPublicHeader(const std::string& file) {
  return file.ends_with(".h") && OwnerOfInternal(file).empty() &&
         !kOnlookers.contains(LayerOf(file));
}

// A folder's own files and tests; benchmarks; fuzz targets, tests/memory and tests/wasm what reads
// bytes; and all tests what makes and measures meshes.
bool MaySeeInternal(const std::string& file, const std::string& owner) {
  const std::string folder = owner.substr(0, owner.find('/'));
  return file.starts_with(owner + "/") || file.starts_with("tests/" + folder + "/") ||
         file.starts_with("bench/") ||
         (file.starts_with("tests/toy_format/") && owner == "codecs/mesh_file") ||
         ((file.starts_with("tests/fuzz/") || file.starts_with("tests/memory/") ||
           file.starts_with("tests/wasm/")) &&
          (folder == "store" || folder == "codecs")) ||
         // Dumps what the engine decodes from.
         (file == "tests/codecs/decode_check/decode_dump.cc" && folder == "query") ||
         (file.starts_with("tests/") && (folder == "tools" || folder == "bench")) ||
         // Codes records that no honest server sends.
         (file == "tests/tools/server/hostile_server_test.cc" && folder == "codecs");
}

// What is between the quotes or brackets of an #include line; empty for other lines.
std::string IncludedBy(const std::string& line) {
  const size_t hash = line.find_first_not_of(" \t");
  if (hash == std::string::npos || line[hash] != '#') return "";
  const size_t word = line.find_first_not_of(" \t", hash + 1);
  if (word == std::string::npos || line.compare(word, 7, "include") != 0) return "";
  const size_t begin = line.find_first_of("<\"", word + 7);
  if (begin == std::string::npos) return "";
  const size_t end = line.find_first_of(">\"", begin + 1);
  return end == std::string::npos ? "" : line.substr(begin + 1, end - begin - 1);
}

// What is wrong with `included` in `file` (a path from the root); empty when nothing is. `headers`
// are all headers of the project, `installed` those that users have.
std::string Wrong(const std::string& file, const std::string& included,
                  const std::set<std::string>& headers, const std::set<std::string>& installed) {
  const std::string layer = LayerOf(file);
  const std::string target = LayerOf(included);
  if (!target.empty()) {
    if (!headers.contains(included)) return "there is no such header";
    if (!kOnlookers.contains(layer) && target != layer) {
      const auto room = kMayInclude.find(layer);
      if (room == kMayInclude.end()) return "there is no room " + layer;
      if (!MayInclude(room->second, layer, target)) return layer + " must not know " + target;
    }
    const std::string owner = OwnerOfInternal(included);
    if (!owner.empty() && !MaySeeInternal(file, owner)) return "private to " + owner;
    if (!owner.empty() && IsPublicHeader(file)) return "a public header must not need private ones";
    if (installed.contains(file) && !installed.contains(included)) return "is not installed";
    return "";
  }
  for (const auto& [library, users] : kLibraryUsers) {
    if (!included.starts_with(library)) continue;
    const bool allowed = std::any_of(users.begin(), users.end(), [&](const std::string& folder) {
      return file.starts_with(folder);
    });
    return allowed ? "" : "this library is not for " + layer;
  }
  if (layer == "base" && (kFileHeaders.contains(included) || included.starts_with("sys/"))) {
    return "base does no file I/O";
  }
  const size_t folder = file.rfind('/') + 1;
  if (headers.contains(file.substr(0, folder) + included))
    return "include it by path from the root";
  return "";
}

// A private header declares what it has in mtdb::internal.
bool OpensInternal(const std::string& path, const std::string& text) {
  const bool is_private =
      path.find("/internal/") != std::string::npos || (kHalls.contains(OwnerOfInternal(path)));
  return kOnlookers.contains(LayerOf(path)) || !is_private || !path.ends_with(".h") ||
         (text.find("\nnamespace mtdb::internal {\n") != std::string::npos &&
          text.find("\nnamespace mtdb {\n") == std::string::npos);
}

using Sources = std::map<std::string, std::string>;  // path from the root -> text

std::vector<std::string> FindViolations(const Sources& sources,
                                        const std::set<std::string>& installed) {
  std::set<std::string> headers;
  for (const auto& [path, text] : sources) {
    if (path.ends_with(".h") || path.ends_with(".inc")) headers.insert(path);
  }
  std::vector<std::string> violations;
  std::map<std::string, std::pair<size_t, size_t>> rooms;  // their lines and files
  for (const auto& [path, text] : sources) {
    if (!OpensInternal(path, text)) violations.push_back(path + ": is not in mtdb::internal");
    std::istringstream lines(text);
    std::string line;
    size_t number = 0;
    while (std::getline(lines, line)) {
      ++number;
      const std::string included = IncludedBy(line);
      if (included.empty()) continue;
      const std::string wrong = Wrong(path, included, headers, installed);
      if (wrong.empty()) continue;
      violations.push_back(path + ":" + std::to_string(number) + ": " + included + ": " + wrong);
    }
    if (!kOnlookers.contains(LayerOf(path))) {
      auto& [room_lines, room_files] = rooms[RoomOf(path)];
      room_lines += number;
      ++room_files;
    }
    if (number > kMaxLines) {
      violations.push_back(path + ": " + std::to_string(number) + " lines, at most " +
                           std::to_string(kMaxLines));
    }
  }
  for (const auto& [room, size] : rooms) {
    if (size.first <= kMostRoomLines && size.second <= kMostRoomFiles) continue;
    if (kLargeRooms.contains(room)) continue;
    violations.push_back(room + ": " + std::to_string(size.second) + " files, " +
                         std::to_string(size.first) + " lines, at most " +
                         std::to_string(kMostRoomFiles) + " and " + std::to_string(kMostRoomLines));
  }
  return violations;
}

std::string ReadText(const std::filesystem::path& path) {
  std::ifstream in(path);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

TEST_CASE("every include of the project points the right way", "[layers]") {
  const std::filesystem::path root = MTDB_SOURCE_DIR;
  Sources sources;
  for (const std::string& folder : kFolders) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(root / folder)) {
      const std::string extension = entry.path().extension().string();
      if (extension != ".h" && extension != ".cc" && extension != ".c" && extension != ".inc") {
        continue;
      }
      sources[entry.path().lexically_relative(root).generic_string()] = ReadText(entry.path());
    }
  }
  CHECK(sources.size() > 100);
  // What `cmake --install` gives: a component and a header a line.
  std::set<std::string> installed;
  std::istringstream list(ReadText(root / "cmake/installed_headers.txt"));
  for (std::string component, header; list >> component >> header;) {
    INFO(header);
    CHECK(sources.contains(header));
    CHECK(IsPublicHeader(header));
    installed.insert(header);
  }
  CHECK(installed.size() > 20);
  for (const std::string& violation : FindViolations(sources, installed)) FAIL_CHECK(violation);
}

// What a client of the update stream cannot have, in a browser.
std::string WrongInClient(const std::string& file, const std::string& text) {
  static const std::set<std::string> kAbsent{
      "atomic", "condition_variable", "filesystem", "fstream",    "future", "iostream",
      "mutex",  "shared_mutex",       "stdexcept",  "stop_token", "thread"};
  // hash.h hides the checksum's library, float4.h the processor; both have another way.
  static const std::set<std::string> kOthers{"xxhash.h", "emmintrin.h"};
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const std::string included = IncludedBy(line);
    const std::string layer = LayerOf(included);
    if (kAbsent.contains(included)) return file + " includes " + included;
    if (!layer.empty() && layer != "base" && layer != "codecs/coding" && layer != "codecs/stream") {
      return file + " knows " + layer;
    }
    if (layer.empty() && included.find_first_of("./") != std::string::npos &&
        !kOthers.contains(included)) {
      return file + " includes " + included;
    }
    for (const char* word : {" throw ", " throw;", "} catch (", " try {"}) {
      const size_t at = line.find(word);
      if (at != std::string::npos && line.find("//") > at) return file + ": " + line;
    }
  }
  return "";
}

TEST_CASE("the client of an update stream needs standard C++ and store/base only", "[layers]") {
  const std::filesystem::path root = MTDB_SOURCE_DIR;
  std::vector<std::string> files;
  std::istringstream list(ReadText(root / "codecs/client_sources.txt"));
  for (std::string file; std::getline(list, file);) files.push_back(file);
  REQUIRE(files.size() > 5);
  // With all headers of the project that they include.
  for (size_t i = 0; i < files.size(); ++i) {
    const std::string text = ReadText(root / files[i]);
    INFO(files[i]);
    REQUIRE(!text.empty());
    CHECK(WrongInClient(files[i], text) == "");
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) {
      const std::string included = IncludedBy(line);
      if (LayerOf(included).empty()) continue;
      if (std::find(files.begin(), files.end(), included) == files.end()) files.push_back(included);
    }
  }
  CHECK(files.size() > 20);
  for (const char* wrong : {"#include <thread>", "#include \"store/database.h\"",
                            "#include \"codecs/cluster/cluster.h\"", "#include <zstd.h>",
                            "#include <sys/mman.h>", "  throw 1;", "  try {"}) {
    CHECK(!WrongInClient("codecs/stream/x.cc", wrong).empty());
  }
  CHECK(WrongInClient("codecs/stream/x.cc", "#include <vector>\n#include \"store/base/ids.h\"\n")
            .empty());
}

TEST_CASE("the checker of includes finds what is wrong", "[layers]") {
  const Sources good{
      {"store/base/ids.h", "#include <cstdint>\n"},
      {"store/database.h", "#include \"store/base/ids.h\"\n"},
      {"store/pages/page.h", "#include \"store/open_options.h\"\n\nnamespace mtdb::internal {\n"},
      {"store/lmdb/environment.h",
       "  #  include <lmdb.h>\n#include \"store/pages/page.h\"\n\nnamespace mtdb::internal {\n"},
      {"store/open_options.h", ""},
      {"store/object_record.h", "#include \"store/base/ids.h\"\n"},
      {"query/fields/split.h", "#include \"query/query.h\"\n\nnamespace mtdb::internal {\n"},
      {"query/query.h", ""},
      {"codecs/cluster/mesh.h", "#include <zstd.h>\n#include \"store/base/ids.h\"\n"},
      {"codecs/coding/rans.h", "// #include \"query/cut.h\" is only text here\n"},
      {"codecs/stream/update.h", "#include \"store/base/ids.h\"\n"},
      {"codecs/stream/internal/update_coder.h",
       "#include \"codecs/coding/rans.h\"\n#include \"codecs/stream/update.h\"\n"
       "\nnamespace mtdb::internal {\n"},
      {"codecs/mesh_file/mesh_file.h", "#include <draco/mesh/mesh.h>\n"},
      {"query/cut.h", "#include \"codecs/cluster/mesh.h\"\n#include \"store/object_record.h\"\n"},
      {"builder/build.h",
       "#include \"codecs/cluster/mesh.h\"\n#include \"store/object_record.h\"\n"},
      {"tools/client/client.h", "#include \"codecs/stream/update.h\"\n"},
      {"tools/client/message.h", "#include <boost/beast/core.hpp>\n"},
      {"tools/server/internal/pool.h",
       "#include \"tools/client/message.h\"\n\nnamespace mtdb::internal {\n"},
      {"tools/server/server.h", "#include \"tools/client/message.h\"\n"},
      {"tools/server/server.cc", "#include \"tools/server/internal/pool.h\"\n"},
      {"tools/render/render.h", "#include \"query/cut.h\"\n"},
      {"tests/tools/pool_test.cc", "#include \"tools/server/internal/pool.h\"\n"},
      {"tools/cli/main.cc",
       "#include \"tools/server/server.h\"\n#include \"tools/client/client.h\"\n"
       "#include \"query/cut.h\"\n#include \"builder/build.h\"\n"},
      {"tests/codecs/coding/rans_test.cc",
       "#include <catch2/catch.hpp>\n"
       "#include \"codecs/coding/rans.h\"\n"},
      {"bench/codecs_bench.cc", "#include \"codecs/coding/rans.h\"\n#include <CGAL/Kernel.h>\n"},
  };
  const std::set<std::string> installed{"store/base/ids.h",      "store/database.h",
                                        "store/object_record.h", "store/open_options.h",
                                        "codecs/cluster/mesh.h", "query/cut.h",
                                        "query/query.h",         "codecs/stream/update.h",
                                        "builder/build.h",       "tools/client/client.h"};
  CHECK(FindViolations(good, installed).empty());

  const std::vector<std::pair<std::string, std::string>> planted{
      {"store/base/ids.h", "store/database.h"},
      {"store/base/ids.h", "codecs/cluster/mesh.h"},
      {"store/base/ids.h", "fstream"},
      {"store/base/ids.h", "sys/stat.h"},
      {"store/database.h", "codecs/cluster/mesh.h"},
      {"store/object_record.h", "store/database.h"},
      {"store/pages/page.h", "store/database.h"},
      {"query/fields/split.h", "query/cut.h"},
      {"query/query.h", "query/fields/split.h"},
      {"query/cut.h", "store/database.h"},
      {"store/database.h", "query/cut.h"},
      {"store/database.h", "builder/build.h"},
      {"store/database.h", "lmdb.h"},
      {"store/pages/page.h", "lmdb.h"},
      {"store/pages/page.h", "store/lmdb/environment.h"},
      {"store/database.h", "zstd.h"},
      {"codecs/cluster/mesh.h", "store/database.h"},
      {"codecs/cluster/mesh.h", "query/cut.h"},
      {"codecs/cluster/mesh.h", "lmdb.h"},
      {"codecs/cluster/mesh.h", "CGAL/Kernel.h"},
      {"codecs/cluster/mesh.h", "codecs/stream/update.h"},
      {"codecs/stream/update.h", "codecs/cluster/mesh.h"},
      {"codecs/coding/rans.h", "codecs/cluster/mesh.h"},
      {"codecs/coding/rans.h", "zstd.h"},
      {"codecs/mesh_file/mesh_file.h", "codecs/cluster/mesh.h"},
      {"codecs/mesh_file/mesh_file.h", "codecs/coding/rans.h"},
      {"codecs/stream/update.h", "codecs/stream/internal/update_coder.h"},
      {"codecs/stream/update.h", "draco/mesh/mesh.h"},
      {"query/cut.h", "codecs/stream/internal/update_coder.h"},
      {"query/cut.h", "codecs/mesh_file/mesh_file.h"},
      {"builder/build.h", "codecs/stream/update.h"},
      {"tools/client/client.h", "query/cut.h"},
      {"tools/client/client.h", "store/database.h"},
      {"tools/client/message.h", "tools/server/server.h"},
      {"tools/render/render.h", "tools/server/server.h"},
      {"tools/render/render.h", "boost/beast/core.hpp"},
      {"tools/server/server.h", "tools/cli/main.h"},
      {"tools/server/server.h", "builder/build.h"},
      {"tools/server/server.h", "CLI/CLI.hpp"},
      {"tools/cli/main.cc", "tools/server/internal/pool.h"},
      {"tools/cli/main.cc", "codecs/coding/rans.h"},
      {"tools/hall/x.cc", "query/cut.h"},
      {"tools/client/client.h", "tools/client/message.h"},
      {"tools/server/server.h", "tools/server/internal/pool.h"},
      {"query/cut.h", "builder/build.h"},
      {"query/cut.h", "tools/cli/main.h"},
      {"query/cut.h", "codecs/coding/rans.h"},
      {"query/cut.h", "store/pages/page.h"},
      {"query/cut.h", "CGAL/Kernel.h"},
      {"query/cut.h", "draco/mesh/mesh.h"},
      {"query/cut.h", "nlohmann/json.hpp"},
      {"tools/cli/main.cc", "nlohmann/json.hpp"},
      {"query/cut.h", "boost/asio/io_context.hpp"},
      {"builder/build.h", "query/cut.h"},
      {"builder/build.h", "store/pages/page.h"},
      {"builder/build.h", "tests/support/mesh_check.h"},
      {"tools/cli/main.cc", "store/pages/page.h"},
      {"tools/cli/main.cc", "lmdb.h"},
      {"tools/cli/main.cc", "catch2/catch.hpp"},
      {"tests/query/cut_test.cc", "store/pages/page.h"},
      {"tests/query/cut_test.cc", "lmdb.h"},
      {"tests/query/cut_test.cc", "query/no_such_header.h"},
      {"codecs/coding/patch.h", "rans.h"},
      {"codecs/cluster/mesh.h", "codecs/coding/rans.h"},
      {"store/database.h", "store/pages/page.h"},
      {"bench/codecs_bench.cc", "catch2/catch.hpp"},
  };
  for (const auto& [file, included] : planted) {
    for (const char* form : {"#include \"\"\n", "# include <>"}) {
      std::string line = form;
      line.insert(line.find_first_of("\"<") + 1, included);
      Sources sources = good;
      sources["tools/cli/main.h"];
      sources["tests/support/mesh_check.h"];
      sources[file] += line;
      INFO(file << " includes " << included);
      const auto violations = FindViolations(sources, installed);
      REQUIRE(violations.size() == 1);
      CHECK(violations[0].starts_with(file + ":"));
      CHECK(violations[0].find(included) != std::string::npos);
    }
  }

  for (const char* text :
       {"\nnamespace mtdb {\n", "\nnamespace mtdb::internal {\n}\n\nnamespace mtdb {\n",
        "struct Pool;\n"}) {
    Sources open = good;
    open["tools/server/internal/pool.h"] = text;
    REQUIRE(FindViolations(open, installed).size() == 1);
    CHECK(FindViolations(open, installed)[0] ==
          "tools/server/internal/pool.h: is not in mtdb::internal");
  }

  Sources lengthy = good;
  for (size_t i = 0; i < kMaxLines; ++i) lengthy["query/answer/cut.cc"] += "\n";
  CHECK(FindViolations(lengthy, installed).empty());
  lengthy["query/answer/cut.cc"] += "\n";
  REQUIRE(FindViolations(lengthy, installed).size() == 1);
  CHECK(FindViolations(lengthy, installed)[0] == "query/answer/cut.cc: 801 lines, at most 800");
}

}  // namespace
}  // namespace mtdb::test
