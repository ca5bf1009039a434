// SPDX-License-Identifier: Apache-2.0
// libFuzzer target: a packed file as a whole, with bytes changed by someone who knows it. The first
// byte says whether the checksums of the index's pages are made right again (bit 0), and those of
// directory and header (bit 1), and how many bytes are missing at the end (bits 4..7). Then changes
// follow: two bytes of offset, one of length, and the bytes.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "store/packed/packed_reader.h"
#include "store/packed/verify_packed.h"
#include "store/packed_file.h"
#include "store/records/keys.h"

namespace {

using namespace mtdb;
using namespace mtdb::internal;

constexpr uint32_t kClusters = 70;  // more than a page of rows
constexpr uint32_t kFine = 60;

Bytes UnitPayload(UnitId u) {
  Bytes bytes(u == kClusters ? 300 : 20 + u % 7);
  for (size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<std::byte>(17 * u + 31 * i);
  return bytes;
}

// An object in memory.
class Source final : public ClusterSource {
 public:
  Source() {
    for (UnitId u = 0; u <= kClusters; ++u) {
      UnitEntry entry;
      entry.round = u < kFine ? 1 : u < kClusters ? 2 : kRootRound;
      entry.hilbert = u == kClusters ? 0 : 10 * u;
      entry.bounds.Add(Vec3i{0, 1, 2});
      entry.nodes = u == kClusters ? 0 : 5;
      entry.external_vertices = 9;
      const Bytes payload = UnitPayload(u);
      const auto bytes = static_cast<uint32_t>(payload.size());
      std::vector<UnitId> children;
      if (u == kClusters) {
        for (UnitId c = kFine; c < kClusters; ++c) children.push_back(c);
      } else if (u >= kFine) {
        for (UnitId c = 0; c < 6; ++c) children.push_back(6 * (u - kFine) + c);
      }
      const uint64_t checksum = Hash64(payload, UnitSeed(u, entry.round, entry.hilbert));
      index_.Add(entry, {u, 0, bytes, checksum}, children);
      record_.payload_bytes += bytes;
    }
    index_.Finish(3);
    record_.id = ObjectId{1};
    record_.name = "a";
    record_.clusters = kClusters;
    record_.root_pieces = 1;
    record_.nodes = 5 * kClusters;
    record_.root_vertices = 3;
    record_.vertices = 3 + record_.nodes;
    record_.bounds.Add(Vec3d{0, 1, 2});
    record_.bounds.Add(Vec3d{3, 4, 5});
    record_.rounds.resize(2);
  }
  const ObjectRecord& record() const override { return record_; }
  const ClusterIndex& index() const override { return index_; }
  void Read(std::span<const UnitId> units, std::shared_ptr<PayloadReceiver> receiver) override {
    for (const UnitId u : units) receiver->Receive(u, UnitPayload(u));
  }

 private:
  ObjectRecord record_;
  ClusterIndex index_;
};

class MemoryRanges final : public RangeReader {
 public:
  explicit MemoryRanges(Bytes bytes) : bytes_(std::move(bytes)) {}
  const std::string& name() const override { return name_; }
  uint64_t size() const override { return bytes_.size(); }
  Ticket Read(ByteRange range, Answer answer) override {
    if (range.offset > bytes_.size() || range.bytes > bytes_.size() - range.offset) {
      __builtin_trap();  // places are checked before they are asked for
    }
    const ByteSpan bytes = ByteSpan(bytes_).subspan(range.offset, range.bytes);
    answer(Bytes(bytes.begin(), bytes.end()));
    return 0;
  }
  bool answers_at_once() const override { return false; }
  uint64_t bytes_read() const override { return 0; }
  uint64_t requests() const override { return 0; }

 private:
  const std::string name_ = "fuzz";
  const Bytes bytes_;
};

struct Good {
  Bytes bytes;
  std::vector<PackedObject> objects;
  uint64_t directory_bytes = 0;
  Good() {
    const std::shared_ptr<ClusterSource> source = std::make_shared<Source>();
    const auto report = PackObjects({&source, 1}, [&](ByteSpan more) {
      bytes.insert(bytes.end(), more.begin(), more.end());
      return Status::Ok();
    });
    const auto file = PackedFile::Open(std::make_shared<MemoryRanges>(bytes));
    if (!report.ok() || !file.ok()) __builtin_trap();
    objects = (*file)->objects();
    directory_bytes = (*file)->header().directory_bytes;
  }
};

void Replace(Bytes* bytes, uint64_t at, ByteSpan with) {
  if (at + with.size() > bytes->size()) return;
  std::copy(with.begin(), with.end(), bytes->begin() + static_cast<ptrdiff_t>(at));
}

void SealPages(const Good& good, Bytes* bytes) {
  std::vector<PackedObject> objects = good.objects;
  for (PackedObject& object : objects) {
    for (uint32_t p = 0; p < object.pages.size(); ++p) {
      PackedPage& page = object.pages[p];
      if (page.offset + page.bytes > bytes->size()) return;
      page.checksum =
          Hash64(ByteSpan(*bytes).subspan(page.offset, page.bytes), PageSeed(object, p));
    }
  }
  Replace(bytes, kPackedHeaderBytes, EncodePackedDirectory(objects));
}

void SealHeader(const Good& good, Bytes* bytes) {
  if (bytes->size() < kPackedHeaderBytes + good.directory_bytes) return;
  PackedHeader header;
  header.file_bytes = bytes->size();
  header.directory_bytes = good.directory_bytes;
  header.first_bytes = good.objects[0].start + good.objects[0].first_bytes;
  SetContentHash(ByteSpan(*bytes).subspan(kPackedHeaderBytes, good.directory_bytes), &header);
  Replace(bytes, 0, EncodePackedHeader(header));
}

// Everything in the file, as a reader gets it: what was written, or an error.
Status ReadAll(const Bytes& bytes, bool whole) {
  MTDB_ASSIGN_OR_RETURN(const auto file, PackedFile::Open(std::make_shared<MemoryRanges>(bytes)));
  for (const PackedObject& object : file->objects()) {
    MTDB_ASSIGN_OR_RETURN(const auto source, PackedSource::Open(file, object, whole));
    for (UnitId u = source->index().unit_count(); u-- > 0;) {
      MTDB_RETURN_IF_ERROR(ReadUnits(*source, {&u, 1}, [](UnitId id, const Bytes& payload) {
        if (payload != UnitPayload(id)) __builtin_trap();
        return Status::Ok();
      }));
    }
  }
  return Status::Ok();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const Good kGood;
  if (size == 0) return 0;
  Bytes bytes = kGood.bytes;
  for (size_t i = 1; i + 3 < size;) {
    const size_t at = data[i] | size_t{data[i + 1]} << 8;
    const size_t length = std::min<size_t>(data[i + 2], size - i - 3);
    for (size_t k = 0; k < length; ++k) {
      bytes[(at + k) % bytes.size()] = static_cast<std::byte>(data[i + 3 + k]);
    }
    i += 3 + length;
  }
  bytes.erase(bytes.end() - (data[0] >> 4), bytes.end());
  if ((data[0] & 1) != 0) SealPages(kGood, &bytes);
  if ((data[0] & 2) != 0) SealHeader(kGood, &bytes);

  CheckReport report;
  const Status verified = VerifyPacked(std::make_shared<MemoryRanges>(bytes), "", &report);
  const Status whole = ReadAll(bytes, true);
  const Status late = ReadAll(bytes, false);
  // What a reader stumbles over is found by the verifier.
  if (verified.ok() && report.ok() && (!whole.ok() || !late.ok())) __builtin_trap();
  // Nobody who does not make the checksums right again goes unnoticed.
  if ((data[0] & 3) == 0 && bytes != kGood.bytes && report.ok()) __builtin_trap();
  return 0;
}
