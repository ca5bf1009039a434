// SPDX-License-Identifier: Apache-2.0
#include "store/lmdb/object_writer.h"

#include <algorithm>
#include <unistd.h>

#include "store/base/out_of_memory.h"
#include "store/lmdb/catalog.h"
#include "store/lmdb/object_index.h"
#include "store/lmdb/test_hooks.h"
#include "store/object_name.h"
#include "store/records/index_codec.h"
#include "store/records/value_packing.h"

namespace mtdb::internal {
namespace {

constexpr uint64_t kBytesPerTransaction = 32 << 20;
constexpr uint64_t kMaxPayloadBytes = 1 << 30;

// An id that no object had and no other builder holds. Nothing is written for it: the lock keeps
// others away, and the first transaction with values makes it known.
Result<std::pair<ObjectId, BuilderLock>> ReserveId(Environment& environment,
                                                   const std::string& name, bool replace) {
  uint64_t candidate = 0;
  std::optional<BuilderLock> lock;  // of the candidate
  for (;;) {
    // Looked up under the lock: who had it before may have used the id in the meantime.
    uint64_t next = 0;
    MTDB_ASSIGN_OR_RETURN(const auto published, environment.Read([&](const Snapshot& snapshot) {
      next = snapshot.superblock().next_object_id;
      return FindObject(snapshot, name);
    }));
    if (published && !replace) {
      return Status(StatusCode::kAlreadyExists,
                    environment.path() + ": object " + name +
                        " is there; choose another name, or replace it");
    }
    if (lock && candidate >= next) return std::pair(ObjectId{candidate}, *std::move(lock));
    candidate = std::max(candidate + (lock ? 0 : 1), next);
    MTDB_ASSIGN_OR_RETURN(lock,
                          BuilderLock::TryAcquire(environment.real_path(), ObjectId{candidate}));
  }
}

}  // namespace

Result<std::unique_ptr<ObjectWriter>> StoreObjectWriter::Create(
    std::shared_ptr<Environment> environment, const std::string& name, bool replace) {
  MTDB_RETURN_IF_ERROR(CheckObjectName(name));
  if (!environment->writable()) {
    return InvalidArgument(environment->path() + ": opened for reading; open it writable");
  }
  MTDB_RETURN_IF_ERROR(RemoveDead(*environment));
  MTDB_ASSIGN_OR_RETURN(auto name_lock, BuilderLock::TryAcquire(environment->real_path(), name));
  if (!name_lock) {
    return Status(StatusCode::kBusy, environment->path() + ": object " + name +
                                         " is being built already; wait for that, or stop it");
  }
  MTDB_ASSIGN_OR_RETURN(auto reserved, ReserveId(*environment, name, replace));
  ReachTestPoint("created");
  return std::unique_ptr<ObjectWriter>(new StoreObjectWriter(
      std::move(environment), name, replace, *std::move(name_lock), std::move(reserved)));
}

StoreObjectWriter::StoreObjectWriter(std::shared_ptr<Environment> environment, std::string name,
                                     bool replace, BuilderLock name_lock,
                                     std::pair<ObjectId, BuilderLock> reserved)
    : environment_(std::move(environment)),
      name_(std::move(name)),
      replace_(replace),
      id_(reserved.first),
      name_lock_(std::move(name_lock)),
      id_lock_(std::move(reserved.second)),
      textures_(name_, [this](uint32_t file, uint32_t part, const Bytes& bytes) {
        return QueueTexturePart(file, part, bytes);
      }) {}

StoreObjectWriter::~StoreObjectWriter() {
  if (published_ || !begun_) return;
  queue_.clear();
  // What cannot be removed now goes at the next Create.
  const Status status = CatchOutOfMemory([&] { return RemoveRemains(*environment_, id_); });
  static_cast<void>(status);
}

Status StoreObjectWriter::CheckChildren(std::span<const UnitId> children, uint32_t below) const {
  for (size_t i = 0; i < children.size(); ++i) {
    if (children[i] >= below || (i > 0 && children[i] <= children[i - 1])) {
      return InvalidArgument("object " + name_ + ": child " + std::to_string(children[i]) +
                             ": expected ascending ids of finer rounds, below " +
                             std::to_string(below));
    }
  }
  return Status::Ok();
}

Result<UnitId> StoreObjectWriter::Add(const UnitEntry& entry, std::span<const UnitId> children,
                                      ByteSpan payload) {
  return CatchOutOfMemory([&]() -> Result<UnitId> {
    const UnitId id = index_.unit_count() + static_cast<uint32_t>(waiting_.size());
    const std::string place = "object " + name_ + ": unit " + std::to_string(id) + ": ";
    if (entry.round == 0 || entry.round < round_) {
      return InvalidArgument(place + "expected a round from " +
                             std::to_string(std::max<int>(round_, 1)) + ", found " +
                             std::to_string(entry.round));
    }
    if (entry.round == round_ && entry.hilbert < hilbert_) {
      return InvalidArgument(place + "hilbert codes of a round must ascend");
    }
    if (entry.bounds.empty() || entry.error_code_min > entry.error_code_max) {
      return InvalidArgument(place + "expected bounds and ordered error codes");
    }
    if (entry.round == kRootRound ? entry.nodes != 0 || entry.in_triangles != 0 ||
                                        entry.explicit_arcs || entry.error_code_max != 0
                                  : entry.nodes == 0) {
      return InvalidArgument(place + "expected nodes in a cluster, and none, nor in-triangles or " +
                             "errors, in a piece of the root");
    }
    if (payload.empty() || payload.size() > kMaxPayloadBytes || id == kNone32 - 1) {
      return InvalidArgument(place + "expected a payload of 1 byte to 1 GiB, found " +
                             std::to_string(payload.size()) + " bytes");
    }
    MTDB_RETURN_IF_ERROR(CheckChildren(children, entry.round == round_ ? round_begin_ : id));
    if (entry.round != round_) {
      round_ = entry.round;
      round_begin_ = id;
    }
    hilbert_ = entry.hilbert;
    Waiting w;
    w.entry = entry;
    w.children.assign(children.begin(), children.end());
    w.payload.assign(payload.begin(), payload.end());
    w.checksum = Hash64(payload, UnitSeed(id, entry.round, entry.hilbert));
    digest_.AddUnit(id, entry.round, entry.hilbert, payload);
    payload_bytes_ += payload.size();
    waiting_bytes_.push_back(payload.size());
    waiting_.push_back(std::move(w));
    MTDB_RETURN_IF_ERROR(PackUnits(false));
    return id;
  });
}

Status StoreObjectWriter::AddTextureFile(uint32_t file, ByteSpan part) {
  return CatchOutOfMemory([&] { return textures_.Add(file, part); });
}

Status StoreObjectWriter::QueueTexturePart(uint32_t file, uint32_t part, const Bytes& bytes) {
  Bytes key = TextureKey(id_, file, part);
  Bytes value = SealValue(Table::kTextures, key, bytes);
  return Queue(Table::kTextures, std::move(key), std::move(value));
}

Status StoreObjectWriter::PackUnits(bool last) {
  for (;;) {
    const size_t count = PayloadsOfNextValue(waiting_bytes_, last);
    if (count == 0) return Status::Ok();
    const UnitEntry& first = waiting_[0].entry;
    values_of_round_ = first.round == value_round_ ? values_of_round_ + 1 : 0;
    value_round_ = first.round;
    const Bytes key = UnitKey(id_, first.round, first.hilbert, values_of_round_);
    Bytes value;
    for (size_t i = 0; i < count; ++i) {
      const Waiting& w = waiting_[i];
      const PayloadLocation location{values_, static_cast<uint32_t>(value.size()),
                                     static_cast<uint32_t>(w.payload.size()), w.checksum};
      index_.Add(w.entry, location, w.children);
      value.insert(value.end(), w.payload.begin(), w.payload.end());
    }
    ++values_;
    waiting_.erase(waiting_.begin(), waiting_.begin() + static_cast<ptrdiff_t>(count));
    waiting_bytes_.erase(waiting_bytes_.begin(),
                         waiting_bytes_.begin() + static_cast<ptrdiff_t>(count));
    MTDB_RETURN_IF_ERROR(Queue(Table::kUnits, key, std::move(value)));
  }
}

Status StoreObjectWriter::QueueIndex() {
  const uint32_t rows = index_.unit_count();
  for (uint32_t first = 0; first < rows; first += std::min(kIndexRowsPerValue, rows - first)) {
    const Bytes body = EncodeIndexRows(index_, first, std::min(kIndexRowsPerValue, rows - first));
    digest_.AddIndexValue(first, body);
    index_checksum_ = ChainIndexValue(index_checksum_, body);
    Bytes key = IndexKey(id_, first);
    Bytes value = SealValue(Table::kIndex, key, body);
    MTDB_RETURN_IF_ERROR(Queue(Table::kIndex, std::move(key), std::move(value)));
  }
  return Status::Ok();
}

Status StoreObjectWriter::Queue(Table table, Bytes key, Bytes value) {
  const uint32_t page_size = environment_->page_size();
  const uint64_t node = kNodeHeaderBytes + key.size() + value.size();
  if (node > MaxNodeBytes(page_size)) {
    overflow_bytes_ += OverflowPages(value.size(), page_size) * page_size;
    node_bytes_ += kNodeHeaderBytes + key.size() + 10;  // a page number, a place in the leaf
  } else {
    node_bytes_ += node + 2;
  }
  queued_bytes_ += value.size();
  queue_.push_back({table, std::move(key), std::move(value)});
  return queued_bytes_ < kBytesPerTransaction ? Status::Ok() : WriteQueue();
}

Status StoreObjectWriter::PutQueue(WriteTransaction& write) const {
  uint64_t& next_id = write.superblock().next_object_id;
  next_id = std::max(next_id, id_.value + 1);
  for (const QueuedValue& v : queue_) MTDB_RETURN_IF_ERROR(write.Put(v.table, v.key, v.value));
  ReachTestPoint("values put");
  return Status::Ok();
}

Status StoreObjectWriter::WriteQueue() {
  if (queue_.empty()) return Status::Ok();
  const Status status = environment_->Write([&](WriteTransaction& write) -> Status {
    const PendingEntry entry{name_, static_cast<uint32_t>(::getpid())};
    MTDB_RETURN_IF_ERROR(
        write.PutSealed(Table::kCatalog, BuildingKey(id_), EncodePendingEntry(entry)));
    return PutQueue(write);
  });
  MTDB_RETURN_IF_ERROR(status);
  begun_ = true;
  queue_.clear();
  queued_bytes_ = 0;
  ReachTestPoint("values committed");
  return Status::Ok();
}

Result<ObjectRecord> StoreObjectWriter::Publish(const ObjectRecord& input,
                                                const BeforePublish& before) {
  return CatchOutOfMemory([&]() -> Result<ObjectRecord> {
    MTDB_CHECK(!published_, "an object is published once");
    MTDB_RETURN_IF_ERROR(PackUnits(true));
    ObjectRecord record = input;
    record.id = id_;
    record.name = name_;
    if (record.clusters != index_.cluster_count() ||
        record.root_pieces != index_.root_piece_count()) {
      return InvalidArgument("object " + name_ + ": the record says " +
                             std::to_string(record.clusters) + " clusters and " +
                             std::to_string(record.root_pieces) + " root pieces, " +
                             std::to_string(index_.cluster_count()) + " and " +
                             std::to_string(index_.root_piece_count()) + " were added");
    }
    MTDB_RETURN_IF_ERROR(textures_.Finish());
    MTDB_RETURN_IF_ERROR(textures_.Check(record));
    MTDB_RETURN_IF_ERROR(QueueIndex());
    digest_.AddRecord(record);
    record.payload_bytes = payload_bytes_;
    record.stored_bytes = overflow_bytes_ + OverflowPages(node_bytes_, environment_->page_size()) *
                                                environment_->page_size();
    record.index_checksum = index_checksum_;
    record.digest_low = digest_.low();
    record.digest_high = digest_.high();
    if (const auto check = DecodeObjectRecord(EncodeObjectRecord(record), "record"); !check.ok()) {
      return InvalidArgument("object " + name_ + ": " + check.status().message());
    }
    if (before) MTDB_RETURN_IF_ERROR(before(record));
    std::optional<ObjectId> replaced;
    MTDB_ASSIGN_OR_RETURN(record, FlipCatalog(std::move(record), &replaced));
    published_ = true;
    ReachTestPoint("published");
    if (replaced) {
      // The object is published whatever comes now; what is left goes at the next Create.
      const Status status =
          CatchOutOfMemory([&] { return RemoveRemains(*environment_, *replaced); });
      static_cast<void>(status);
    }
    return record;
  });
}

Result<ObjectRecord> StoreObjectWriter::FlipCatalog(ObjectRecord record,
                                                    std::optional<ObjectId>* replaced) {
  const Status status = environment_->Write([&](WriteTransaction& write) -> Status {
    replaced->reset();
    // With what is still queued: a transaction of its own would leave pages to no use.
    MTDB_RETURN_IF_ERROR(PutQueue(write));
    MTDB_ASSIGN_OR_RETURN(const auto old, FindObject(write, environment_->path(), name_));
    if (old && !replace_) {
      return {StatusCode::kAlreadyExists,
              environment_->path() + ": object " + name_ + " was published meanwhile"};
    }
    if (old) {
      MTDB_RETURN_IF_ERROR(MakeGarbage(write, *old));
      *replaced = old->id;
    }
    if (begun_) MTDB_RETURN_IF_ERROR(write.Delete(Table::kCatalog, BuildingKey(id_)));
    MTDB_RETURN_IF_ERROR(
        write.PutSealed(Table::kCatalog, ObjectKey(name_), EncodeObjectRecord(record)));
    ReachTestPoint("catalog put");
    return Status::Ok();
  });
  MTDB_RETURN_IF_ERROR(status);
  queue_.clear();
  return record;
}

}  // namespace mtdb::internal
