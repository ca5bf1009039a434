// SPDX-License-Identifier: Apache-2.0
#include "tests/store/store_fixture.h"

#include <algorithm>
#include <atomic>
#include <catch2/catch.hpp>
#include <fstream>
#include <sys/wait.h>
#include <unistd.h>

#include "store/base/hash.h"
#include "store/texture_pages.h"

namespace mtdb::test {

TempDir::TempDir() {
  static std::atomic<int> counter{0};
  path_ = std::filesystem::temp_directory_path() /
          ("mtdb_store_test_" + std::to_string(::getpid()) + "_" + std::to_string(counter++));
  std::filesystem::remove_all(path_);  // of a process of this number that was killed
  std::filesystem::create_directories(path_);
}

TempDir::~TempDir() {
  std::error_code error;
  std::filesystem::remove_all(path_, error);
}

namespace {

Bytes RandomBytes(std::mt19937_64& random, size_t size) {
  Bytes b(size);
  for (std::byte& x : b) x = static_cast<std::byte>(random());
  return b;
}

Box3i RandomBounds(std::mt19937_64& random) {
  Box3i box;
  for (int i = 0; i < 2; ++i) {
    box.Add(Vec3i{static_cast<int32_t>(random()), static_cast<int32_t>(random()) >> 8,
                  static_cast<int32_t>(random()) >> 20});
  }
  return box;
}

std::vector<UnitId> RandomChildren(std::mt19937_64& random, uint32_t below) {
  std::vector<UnitId> children;
  for (uint32_t c = 0; c < below; ++c) {
    if (random() % 8 == 0) children.push_back(c);
  }
  return children;
}

// Small parts before large ones, an empty one among them.
Status AddFile(ObjectWriter& writer, uint32_t page, ByteSpan file) {
  for (size_t size = 0; !file.empty(); size = size * 3 + 1) {
    const ByteSpan part = file.first(std::min(size, file.size()));
    MTDB_RETURN_IF_ERROR(writer.AddTextureFile(page, part));
    file = file.subspan(part.size());
  }
  return Status::Ok();
}

void AddTexture(const SyntheticOptions& options, std::mt19937_64& random, SyntheticObject* o) {
  if (options.page_bytes.empty()) return;
  TextureRecord& texture = o->record.texture.emplace();
  texture.step = 0.25;
  for (const size_t bytes : options.page_bytes) {
    const Bytes& file = o->files.emplace_back(RandomBytes(random, bytes));
    texture.pages.push_back({"page" + std::to_string(o->files.size()) + ".jpg", "image/jpeg", 640,
                             480, bytes, bytes == 0 ? 0 : Hash64(file)});
  }
  if (options.tile_bytes == 0) return;
  const Bytes& tiles = o->files.emplace_back(RandomBytes(random, options.tile_bytes));
  texture.tiles = {tiles.size(), Hash64(tiles)};
}

}  // namespace

SyntheticObject MakeObject(const SyntheticOptions& options) {
  std::mt19937_64 random(options.seed);
  SyntheticObject o;
  uint8_t round = 1;
  for (uint32_t count = options.clusters; count > 0; count /= 4, ++round) {
    const auto finer = static_cast<uint32_t>(o.units.size());
    uint64_t hilbert = random() % 1000;
    RoundReport report;
    for (uint32_t i = 0; i < count; ++i) {
      SyntheticObject::Unit c;
      c.entry.round = round;
      c.entry.hilbert = hilbert;
      hilbert += random() % 3 == 0 ? 0 : random() % (uint64_t{1} << 40);
      c.entry.bounds = RandomBounds(random);
      c.entry.nodes = 1 + static_cast<uint32_t>(random() % 4000);
      c.entry.in_triangles = static_cast<uint32_t>(random() % 9000);
      c.entry.out_triangles = static_cast<uint32_t>(random() % 9000);
      c.entry.external_vertices = static_cast<uint32_t>(random() % 900);
      c.entry.error_code_min = static_cast<uint8_t>(random() % 100);
      c.entry.error_code_max = static_cast<uint8_t>(c.entry.error_code_min + random() % 100);
      c.entry.explicit_arcs = random() % 5 == 0;
      c.children = RandomChildren(random, finer);
      c.payload = RandomBytes(random, 1 + random() % options.max_payload);
      o.record.nodes += c.entry.nodes;
      report.nodes += c.entry.nodes;
      o.units.push_back(std::move(c));
    }
    report.clusters = count;
    o.record.rounds.push_back(report);
  }
  o.record.clusters = static_cast<uint32_t>(o.units.size());
  o.record.root_pieces = 1 + options.clusters / 16;
  for (uint32_t i = 0; i < o.record.root_pieces; ++i) {
    SyntheticObject::Unit p;
    p.entry.round = kRootRound;
    p.entry.bounds = RandomBounds(random);
    p.entry.out_triangles = static_cast<uint32_t>(random() % 9000);
    p.entry.external_vertices = static_cast<uint32_t>(17 + random() % 9000);
    p.children = RandomChildren(random, o.record.clusters);
    p.payload = RandomBytes(random, 1 + random() % options.max_payload);
    o.record.root_triangles += p.entry.out_triangles;
    o.units.push_back(std::move(p));
  }
  o.record.root_vertices = 17;
  o.record.vertices = 17 + o.record.nodes;
  o.record.bounds.Add(Vec3d{0, 1, 2});
  o.record.bounds.Add(Vec3d{3, 4, 5});
  o.record.attributes.attributes = {{"red", ScalarType::kUint8}, {"quality", ScalarType::kFloat32}};
  o.record.units = std::string("m");
  AddTexture(options, random, &o);
  return o;
}

Result<ObjectRecord> WriteObject(Database& database, const std::string& name,
                                 const SyntheticObject& object, bool replace) {
  MTDB_ASSIGN_OR_RETURN(const auto writer, database.Create(name, replace));
  for (const auto& u : object.units) {
    const auto id = writer->Add(u.entry, u.children, u.payload);
    if (!id.ok()) return id.status();
  }
  for (uint32_t page = 0; page < object.files.size(); ++page) {
    MTDB_RETURN_IF_ERROR(AddFile(*writer, page, object.files[page]));
  }
  return writer->Publish(object.record);
}

Status CompareObject(ClusterSource& source, const SyntheticObject& object) {
  const ClusterIndex& index = source.index();
  const auto differs = [](const std::string& what) {
    return InvalidArgument(std::string("differs: ").append(what));
  };
  if (index.unit_count() != object.units.size()) return differs("unit count");
  if (index.cluster_count() != object.record.clusters) return differs("cluster count");
  std::vector<UnitId> ids;
  for (UnitId id = 0; id < index.unit_count(); ++id) {
    const auto& u = object.units[id];
    ids.push_back(id);
    if (index.unit(id) != u.entry) return differs("entry of unit " + std::to_string(id));
    if (!std::ranges::equal(index.children(id), u.children)) return differs("children");
  }
  size_t received = 0;
  MTDB_RETURN_IF_ERROR(ReadUnits(source, ids, [&](UnitId id, Bytes payload) {
    ++received;
    return payload == object.units[id].payload ? Status::Ok() : differs("payload");
  }));
  if (received != ids.size()) return differs("number of payloads");
  return CompareFiles(source, object);
}

Status CompareFiles(ClusterSource& source, const SyntheticObject& object) {
  const auto differs = [](uint32_t page) {
    return InvalidArgument("differs: file of page " + std::to_string(page));
  };
  for (uint32_t page = 0; page < object.files.size(); ++page) {
    const Bytes& file = object.files[page];
    Bytes joined;
    MTDB_RETURN_IF_ERROR(ReadTextureFile(source, page, [&](ByteSpan part) {
      joined.insert(joined.end(), part.begin(), part.end());
      return Status::Ok();
    }));
    if (joined != file) return differs(page);
    MTDB_ASSIGN_OR_RETURN(const Bytes whole, source.ReadTextureFile(page, 0, file.size()));
    if (whole != file) return differs(page);
  }
  return Status::Ok();
}

std::string VerifyFailures(const std::string& path, const std::string& object) {
  CheckReport report;
  const Status status = VerifyStore(path, object, &report);
  std::string all;
  if (!status.ok()) all += status.message() + "\n";
  for (const std::string& f : report.failures) all += f + "\n";
  return all;
}

Bytes ReadFile(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  const std::string s((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  const ByteSpan b = AsBytes(s);
  return Bytes(b.begin(), b.end());
}

void WriteFile(const std::string& path, ByteSpan bytes) {
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  out.write(reinterpret_cast<const char*>(bytes.data()),
            static_cast<std::streamsize>(bytes.size()));
}

std::shared_ptr<Database> OpenWritable(const std::string& path) {
  OpenOptions options;
  options.writable = true;
  auto database = Database::Open(path, options);
  if (!database.ok()) FAIL(database.status().message());
  return *database;
}

std::shared_ptr<Database> OpenReadOnly(const std::string& path) {
  auto database = Database::Open(path);
  if (!database.ok()) FAIL(database.status().message());
  return *database;
}

int RunChild(const std::function<int()>& body) {
  const pid_t child = ::fork();
  if (child == 0) ::_exit(body());
  int status = 0;
  ::waitpid(child, &status, 0);
  return status;
}

}  // namespace mtdb::test
