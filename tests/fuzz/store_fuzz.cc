// SPDX-License-Identifier: Apache-2.0
// libFuzzer target: a store file as a whole, with bytes changed by someone who knows it. The first
// byte says how many pages are missing at the end (bits 0..3) and whether a writer opens the file
// too (bit 7). Then changes follow: two bytes of offset, one of length, and the bytes.
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "store/database.h"
#include "store/verify_store.h"
#include "tests/support/temporary_folder.h"

namespace {

using mtdb::Status;
using mtdb::UnitId;

constexpr uint32_t kClusters = 6;
constexpr size_t kPageBytes = 4096;

// Payloads of the length that the test wants, whose content follows from their number.
mtdb::Bytes Payload(uint32_t number, size_t size_bytes) {
  mtdb::Bytes bytes(size_bytes);
  for (size_t i = 0; i < size_bytes; ++i) {
    bytes[i] = static_cast<std::byte>(17 * number + 31 * i + i / 251);
  }
  return bytes;
}
mtdb::Bytes UnitPayload(UnitId u) {
  return Payload(u, u == kClusters ? 300 : u % 2 == 0 ? 40 : 2500);
}

Status Write(mtdb::Database& database, const std::string& name) {
  MTDB_ASSIGN_OR_RETURN(const auto writer, database.Create(name, false));
  mtdb::ObjectRecord record;
  for (uint32_t c = 0; c < kClusters; ++c) {
    mtdb::UnitEntry entry;
    entry.round = static_cast<uint8_t>(1 + c / 3);
    entry.hilbert = 10 * c;
    entry.bounds.Add(mtdb::Vec3i{0, 1, 2});
    entry.nodes = 5;
    const UnitId child{0};
    const auto id = writer->Add(entry, {&child, c >= 3 ? size_t{1} : 0}, UnitPayload(c));
    if (!id.ok()) return id.status();
    if (c % 3 == 0) record.rounds.emplace_back();
  }
  const UnitId child{kClusters - 1};
  mtdb::UnitEntry piece;
  piece.round = mtdb::kRootRound;
  piece.bounds.Add(mtdb::Vec3i{0, 1, 2});
  const auto id = writer->Add(piece, {&child, 1}, UnitPayload(kClusters));
  if (!id.ok()) return id.status();
  record.clusters = kClusters;
  record.root_pieces = 1;
  record.nodes = 5 * kClusters;
  record.root_vertices = 3;
  record.vertices = 3 + record.nodes;
  record.bounds.Add(mtdb::Vec3d{0, 1, 2});
  record.bounds.Add(mtdb::Vec3d{3, 4, 5});
  return writer->Publish(record).status();
}

// A store of two objects and of free pages, and where its changed copies go.
class Place {
 public:
  Place() {
    if (!Make().ok()) __builtin_trap();
    std::ifstream file(path(), std::ios::binary);
    good_.assign(std::istreambuf_iterator<char>(file), {});
  }
  std::string path() const { return folder_.path() + "/store.mtdb"; }
  const std::string& good() const { return good_; }

 private:
  Status Make() const {
    MTDB_ASSIGN_OR_RETURN(const auto database, mtdb::Database::Open(path(), {.writable = true}));
    for (const char* name : {"removed", "first", "second"}) {
      MTDB_RETURN_IF_ERROR(Write(*database, name));
    }
    return database->Remove("removed");
  }
  const mtdb::testing::TemporaryFolder folder_;
  std::string good_;
};

// Everything in the store, as a reader gets it.
Status ReadAll(const std::string& path) {
  MTDB_ASSIGN_OR_RETURN(const auto database, mtdb::Database::Open(path));
  MTDB_ASSIGN_OR_RETURN(const auto objects, database->List());
  for (const mtdb::ObjectRecord& object : objects) {
    MTDB_ASSIGN_OR_RETURN(const auto source, database->OpenObject(object.name));
    std::vector<UnitId> ids;
    for (UnitId u = 0; u < source->index().unit_count(); ++u) ids.push_back(u);
    // A payload is the one that was written, or an error.
    MTDB_RETURN_IF_ERROR(ReadUnits(*source, ids, [](UnitId id, const mtdb::Bytes& payload) {
      if (payload != UnitPayload(id)) __builtin_trap();
      return Status::Ok();
    }));
  }
  return Status::Ok();
}

Status ChangeStore(const std::string& path) {
  MTDB_ASSIGN_OR_RETURN(const auto database, mtdb::Database::Open(path, {.writable = true}));
  MTDB_RETURN_IF_ERROR(database->Remove("first"));
  return Write(*database, "third");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const Place kPlace;
  if (size == 0) return 0;
  std::string bytes = kPlace.good();
  for (size_t i = 1; i + 3 < size;) {
    const size_t at = data[i] | size_t{data[i + 1]} << 8;
    const size_t length = std::min<size_t>(data[i + 2], size - i - 3);
    for (size_t k = 0; k < length; ++k) {
      bytes[(at + k) % bytes.size()] = static_cast<char>(data[i + 3 + k]);
    }
    i += 3 + length;
  }
  bytes.resize(bytes.size() - std::min(bytes.size(), (data[0] & 15) * kPageBytes));
  std::ofstream(kPlace.path(), std::ios::binary) << bytes;

  mtdb::CheckReport report;
  const Status verified = mtdb::VerifyStore(kPlace.path(), "", &report);
  const Status read = ReadAll(kPlace.path());
  // What a reader stumbles over is found by the verifier.
  if (verified.ok() && report.ok() && !read.ok()) __builtin_trap();
  if ((data[0] & 128) != 0) (void)ChangeStore(kPlace.path()).ok();
  return 0;
}
