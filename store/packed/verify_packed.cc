// SPDX-License-Identifier: Apache-2.0
#include "store/packed/verify_packed.h"

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "store/packed/packed_reader.h"
#include "store/records/index_codec.h"
#include "store/records/keys.h"
#include "store/records/object_digest.h"
#include "store/records/value_packing.h"
#include "store/texture_pages.h"

namespace mtdb::internal {
namespace {

constexpr size_t kMaxFailures = 200;
constexpr size_t kUnitsAtOnce = 64;

// The index as a store has it, whose values follow from the lengths of the payloads.
ClusterIndex StoreIndexOf(const ClusterIndex& packed) {
  ClusterIndex index;
  std::vector<uint64_t> waiting;
  UnitId next = 0;
  uint32_t values = 0;
  for (UnitId u = 0; u < packed.unit_count(); ++u) {
    waiting.push_back(packed.location(u).length);
    const bool last = u + 1 == packed.unit_count();
    for (;;) {
      const size_t count = PayloadsOfNextValue(waiting, last);
      if (count == 0) break;
      uint32_t offset = 0;
      for (size_t i = 0; i < count; ++i, ++next) {
        const PayloadLocation& at = packed.location(next);
        index.Add(packed.unit(next), {values, offset, at.length, at.checksum},
                  packed.children(next));
        offset += at.length;
      }
      ++values;
      waiting.erase(waiting.begin(), waiting.begin() + static_cast<ptrdiff_t>(count));
    }
  }
  return index;
}

class PackedVerifier {
 public:
  PackedVerifier(std::shared_ptr<PackedFile> file, CheckReport* report,
                 const std::function<bool()>& stopped)
      : file_(std::move(file)), name_(file_->ranges().name()), report_(report), stopped_(stopped) {}

  Status Run(const std::string& only) {
    report_->checks.push_back("header, directory, size of the file");
    size_t checked = 0;
    for (const PackedObject& object : file_->objects()) {
      if (!only.empty() && object.record.name != only) continue;
      ++checked;
      MTDB_RETURN_IF_ERROR(CheckObject(object));
    }
    if (only.empty() || checked > 0) return Status::Ok();
    Fail(file_->Find(only).status().message());
    return Status::Ok();
  }

 private:
  void Fail(std::string message) {
    if (report_->failures.size() < kMaxFailures) report_->failures.push_back(std::move(message));
  }
  Status Go() const {
    if (!stopped_ || !stopped_()) return Status::Ok();
    return {StatusCode::kCancelled, name_ + ": the check was cancelled"};
  }
  // What the file itself is not to blame for ends the check.
  Status Judge(const Status& status) {
    if (status.ok()) return status;
    if (status.code() != StatusCode::kCorrupt && status.code() != StatusCode::kUnsupported) {
      return status;
    }
    Fail(status.message());
    return Status::Ok();
  }

  Status CheckObject(const PackedObject& object) {
    const auto source = PackedSource::Open(file_, object, true);
    if (!source.ok()) return Judge(source.status());
    const ClusterIndex& index = (*source)->index();
    const std::string& label = object.record.name;
    CheckPlaces(object, index);
    ObjectDigest digest;
    MTDB_ASSIGN_OR_RETURN(const bool whole, CheckPayloads(**source, object, &digest));
    MTDB_RETURN_IF_ERROR(CheckTexture(**source));
    report_->checks.push_back(label + ": checksums of " + std::to_string(object.pages.size()) +
                              " index pages, " + std::to_string(object.record.clusters) +
                              " clusters and " + std::to_string(object.record.root_pieces) +
                              " root pieces");
    if (whole) CheckDigest(object, index, digest);
    return Status::Ok();
  }

  // Pages and payloads fill the object's bytes, in the order of refining.
  void CheckPlaces(const PackedObject& object, const ClusterIndex& index) {
    const std::string place = name_ + ": object " + object.record.name + ": ";
    std::map<uint64_t, uint64_t> ranges;  // offset -> bytes
    bool twice = false;
    for (const PackedPage& page : object.pages) {
      twice |= !ranges.emplace(page.offset, page.bytes).second;
    }
    for (UnitId u = 0; u < index.unit_count(); ++u) {
      const PayloadLocation& at = index.location(u);
      twice |= !ranges.emplace(PackedOffset(at), at.length).second;
    }
    uint64_t end = object.start;
    for (const auto& [offset, bytes] : ranges) {
      if (offset != end) break;
      end += bytes;
    }
    if (twice || end != object.textures) {
      Fail(place + "pages and payloads overlap or leave gaps at byte " + std::to_string(end));
    }
    for (UnitId u = 0; u < index.unit_count(); ++u) {
      const uint64_t offset = PackedOffset(index.location(u));
      const auto after = [&](UnitId other) {
        return object.pages[object.page_of(other)].offset > offset;
      };
      bool wrong = after(u) || std::ranges::any_of(index.parents(u), after);
      wrong = wrong || std::ranges::any_of(index.children(u), after);
      const bool same_round = u > 0 && index.unit(u - 1).round == index.unit(u).round;
      if (u > 0 && (PackedOffset(index.location(u - 1)) < offset) != same_round) wrong = true;
      if (wrong) {
        Fail(place + UnitLabel(object.record, u) + " does not lie in the order of refining");
        return;
      }
    }
  }

  // False when some are wrong.
  Result<bool> CheckPayloads(ClusterSource& source, const PackedObject& object,
                             ObjectDigest* digest) {
    const ClusterIndex& index = source.index();
    std::vector<UnitId> order(index.unit_count());
    for (UnitId u = 0; u < order.size(); ++u) order[u] = u;
    std::ranges::sort(order, {}, [&](UnitId u) { return PackedOffset(index.location(u)); });
    bool whole = true;
    uint64_t payload_bytes = 0;
    const auto read = [&](std::span<const UnitId> units) {
      std::vector<std::pair<UnitId, Bytes>> payloads;
      MTDB_RETURN_IF_ERROR(ReadUnits(source, units, [&](UnitId u, Bytes payload) {
        payloads.emplace_back(u, std::move(payload));
        return Status::Ok();
      }));
      for (const auto& [u, payload] : payloads) {
        payload_bytes += payload.size();
        digest->AddUnit(u, index.unit(u).round, index.unit(u).hilbert, payload);
      }
      return Status::Ok();
    };
    for (size_t i = 0; i < order.size(); i += kUnitsAtOnce) {
      MTDB_RETURN_IF_ERROR(Go());
      const auto batch = std::span(order).subspan(i, std::min(kUnitsAtOnce, order.size() - i));
      if (read(batch).ok()) continue;
      for (const UnitId& u : batch) {  // which of them?
        const Status status = read({&u, 1});
        whole = whole && status.ok();
        MTDB_RETURN_IF_ERROR(Judge(status));
      }
    }
    if (whole && payload_bytes != object.record.payload_bytes) {
      Fail(name_ + ": object " + object.record.name + ": payload bytes: expected " +
           std::to_string(object.record.payload_bytes) + " of its record, found " +
           std::to_string(payload_bytes));
    }
    return whole;
  }

  Status CheckTexture(ClusterSource& source) {
    const ObjectRecord& record = source.record();
    if (!record.texture) return Status::Ok();
    const uint32_t files = record.texture->files();
    bool whole = true;
    for (uint32_t file = 0; file < files; ++file) {
      const Status status = ReadTextureFile(source, file, [&](ByteSpan) { return Go(); });
      whole = whole && status.ok();
      MTDB_RETURN_IF_ERROR(Judge(status));
    }
    if (!whole) return Status::Ok();
    report_->checks.push_back(record.name + ": checksums of " + std::to_string(files - 1) +
                              (files == 2 ? " page" : " pages") +
                              " of its texture, and of its tiles");
    return Status::Ok();
  }

  void CheckDigest(const PackedObject& object, const ClusterIndex& packed, ObjectDigest digest) {
    const ClusterIndex index = StoreIndexOf(packed);
    uint64_t chain = 0;
    for (UnitId first = 0; first < index.unit_count(); first += kIndexRowsPerValue) {
      const Bytes body =
          EncodeIndexRows(index, first, std::min(kIndexRowsPerValue, index.unit_count() - first));
      chain = ChainIndexValue(chain, body);
      digest.AddIndexValue(first, body);
    }
    digest.AddRecord(object.record);
    const ObjectRecord& record = object.record;
    if (chain != record.index_checksum || digest.low() != record.digest_low ||
        digest.high() != record.digest_high) {
      Fail(name_ + ": object " + record.name + ": digest: expected " + record.digest_hex() +
           " of its record, found another");
    }
    report_->checks.push_back(record.name + ": order, counts and digest");
  }

  const std::shared_ptr<PackedFile> file_;
  const std::string& name_;
  CheckReport* report_;
  const std::function<bool()>& stopped_;
};

}  // namespace

Status VerifyPacked(std::shared_ptr<RangeReader> ranges, const std::string& object,
                    CheckReport* report, const std::function<bool()>& stopped) {
  auto file = PackedFile::Open(std::move(ranges));
  if (!file.ok()) {
    const StatusCode code = file.status().code();
    if (code != StatusCode::kCorrupt && code != StatusCode::kUnsupported) return file.status();
    report->failures.push_back(file.status().message());
    return Status::Ok();
  }
  CheckReport found = *report;
  MTDB_RETURN_IF_ERROR(PackedVerifier(*std::move(file), &found, stopped).Run(object));
  *report = std::move(found);
  return Status::Ok();
}

}  // namespace mtdb::internal
