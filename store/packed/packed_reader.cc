// SPDX-License-Identifier: Apache-2.0
#include "store/packed/packed_reader.h"

#include <algorithm>
#include <utility>

#include "store/base/hash.h"
#include "store/base/out_of_memory.h"
#include "store/carriers/url_carriers.h"
#include "store/records/keys.h"
#include "store/records/no_such_object.h"
#include "store/records/page_parts.h"

namespace mtdb::internal {

namespace {

// Reads the range for `take`; once more when it was damaged, and a copy.
template <typename Take>
Status ReadChecked(RangeReader& ranges, ByteRange range, Take&& take) {
  for (bool again = false;; again = true) {
    MTDB_ASSIGN_OR_RETURN(Bytes bytes, ReadRange(ranges, range));
    const Status status = take(std::move(bytes));
    if (status.code() != StatusCode::kCorrupt || !ranges.Forget(range) || again) return status;
  }
}

}  // namespace

Result<std::shared_ptr<PackedFile>> PackedFile::Open(std::shared_ptr<RangeReader> ranges) {
  std::shared_ptr<PackedFile> file(new PackedFile(std::move(ranges)));
  RangeReader& reader = *file->ranges_;
  const std::string& name = reader.name();
  const uint64_t first = std::min(reader.size(), kFirstReadBytes);
  const auto take_directory = [&](ByteSpan directory) -> Status {
    MTDB_ASSIGN_OR_RETURN(file->objects_, DecodePackedDirectory(directory, file->header_, name));
    return Status::Ok();
  };
  bool has_directory = false;
  MTDB_RETURN_IF_ERROR(ReadChecked(reader, {0, first}, [&](ByteSpan head) -> Status {
    MTDB_ASSIGN_OR_RETURN(file->header_, DecodePackedHeader(head, reader.size(), name));
    has_directory = kPackedHeaderBytes + file->header_.directory_bytes <= head.size();
    if (!has_directory) return Status::Ok();
    return take_directory(head.subspan(kPackedHeaderBytes, file->header_.directory_bytes));
  }));
  if (has_directory) return file;
  MTDB_RETURN_IF_ERROR(
      ReadChecked(reader, {kPackedHeaderBytes, file->header_.directory_bytes}, take_directory));
  return file;
}

Result<const PackedObject*> PackedFile::Find(const std::string& name) const {
  for (const PackedObject& object : objects_) {
    if (object.record.name == name) return &object;
  }
  return NoSuchObject(ranges_->name(), name, objects_,
                      [](const PackedObject& o) -> const ObjectRecord& { return o.record; });
}

PackedSource::PackedSource(std::shared_ptr<PackedFile> file, const PackedObject& object, bool whole,
                           const PackedRequests& how)
    : file_(std::move(file)),
      object_(object),
      place_(file_->ranges().name() + ": object " + object.record.name),
      at_once_(whole && file_->ranges().answers_at_once()),
      how_(how),
      index_(object.record.clusters, object.record.root_pieces, object.record.root_vertices),
      pages_(object.pages.size()) {}

Result<std::shared_ptr<ClusterSource>> PackedSource::Open(std::shared_ptr<PackedFile> file,
                                                          const PackedObject& object, bool whole,
                                                          const PackedRequests& requests) {
  const std::shared_ptr<PackedSource> source(
      new PackedSource(std::move(file), object, whole, requests));
  MTDB_RETURN_IF_ERROR(whole ? source->ReadWholeIndex() : source->ReadFirstRows());
  MTDB_RETURN_IF_ERROR(source->CheckRoot());
  return std::shared_ptr<ClusterSource>(source);
}

Status PackedSource::ReadWholeIndex() {
  for (uint32_t p = 0; p < pages_.size(); ++p) {
    MTDB_RETURN_IF_ERROR(ReadPage(p));
  }
  return Status::Ok();
}

Status PackedSource::ReadPage(uint32_t page) {
  const PackedPage& entry = object_.pages[page];
  return ReadChecked(file_->ranges(), {entry.offset, entry.bytes}, [&](ByteSpan bytes) {
    const MutexLock lock(mutex_);
    return PutPage(page, bytes);
  });
}

// The first read has them, or most of them.
Status PackedSource::ReadFirstRows() {
  for (;;) {
    std::vector<uint32_t> missing;
    {
      const MutexLock lock(mutex_);
      for (UnitId u = index_.cluster_count(); u < index_.unit_count() && missing.empty(); ++u) {
        missing = MissingPages(u);
      }
    }
    if (missing.empty()) return Status::Ok();
    for (const uint32_t p : missing) MTDB_RETURN_IF_ERROR(ReadPage(p));
  }
}

Status PackedSource::CheckRoot() const {
  uint64_t most = 0;
  for (UnitId u = index_.cluster_count(); u < index_.unit_count(); ++u) {
    most += index_.unit(u).external_vertices;
  }
  if (object_.record.root_vertices <= most) return Status::Ok();
  return Corrupt(place_ + ": the record says " + std::to_string(object_.record.root_vertices) +
                 " root vertices, but the root pieces have " + std::to_string(most));
}

Status PackedSource::CheckPayload(UnitId unit, ByteSpan payload) const {
  const UnitEntry& entry = index_.unit(unit);
  const PayloadLocation& location = index_.location(unit);
  if (Hash64(payload, UnitSeed(unit, entry.round, entry.hilbert)) == location.checksum) {
    return Status::Ok();
  }
  return Corrupt(place_ + ": " + UnitLabel(object_.record, unit) + ", offset " +
                 std::to_string(PackedOffset(location)) +
                 " of the file: its checksum is wrong; get the file anew");
}

// The rows that ClusterSource promises with a unit.
std::vector<uint32_t> PackedSource::MissingPages(UnitId unit) const {
  std::vector<uint32_t> missing;
  const auto has = [&](UnitId u) {
    if (index_.Has(u)) return true;
    const uint32_t page = object_.page_of(u);
    if (std::ranges::find(missing, page) == missing.end()) missing.push_back(page);
    return false;
  };
  if (!has(unit)) return missing;
  for (const UnitId p : index_.parents(unit)) has(p);
  for (const UnitId c : index_.children(unit)) has(c);
  return missing;
}

void PackedSource::Advance(const QuestionPtr& question, std::vector<Part>* wanted,
                           std::vector<Delivery>* deliveries) {
  const UnitId unit = question->unit;
  const std::vector<uint32_t> missing = MissingPages(unit);
  for (const uint32_t p : missing) {
    if (pages_[p] != PageState::kNone) continue;
    pages_[p] = PageState::kAsked;
    wanted->push_back({{object_.pages[p].offset, object_.pages[p].bytes}, p, nullptr});
  }
  if (index_.Has(unit) && !question->asked) {
    question->asked = true;
    const PayloadLocation& location = index_.location(unit);
    wanted->push_back({{PackedOffset(location), location.length}, 0, question});
  }
  if (!missing.empty() || !question->there) return;
  deliveries->push_back({question->receiver, unit, std::move(question->payload)});
  std::erase(questions_, question);
}

Status PackedSource::PutPage(uint32_t page, ByteSpan bytes) {
  if (pages_[page] == PageState::kThere) return Status::Ok();
  MTDB_ASSIGN_OR_RETURN(const std::vector<PackedRow> rows,
                        DecodePackedPage(bytes, object_, page, file_->ranges().name()));
  VertexIndex vertex = object_.pages[page].first_vertex;
  UnitId unit = object_.first_unit(page);
  for (const PackedRow& row : rows) {
    MTDB_RETURN_IF_ERROR(PutRow(unit, row, vertex));
    vertex += row.entry.nodes;
    ++unit;
  }
  pages_[page] = PageState::kThere;
  return Status::Ok();
}

Status PackedSource::PutRow(UnitId unit, const PackedRow& row, VertexIndex first_vertex) {
  const auto contradiction = [&](UnitId other) {
    return Corrupt(place_ + ": index: " + UnitLabel(object_.record, unit) + " and " +
                   UnitLabel(object_.record, other) +
                   " do not agree that one is the other's child, or on its errors");
  };
  const auto has = [](std::span<const UnitId> units, UnitId u) {
    return std::ranges::binary_search(units, u);
  };
  for (const UnitId c : row.children) {
    if (!index_.Has(c)) continue;
    if (!has(index_.parents(c), unit) || index_.unit(c).round >= row.entry.round ||
        index_.unit(c).error_code_max > row.error_code_below) {
      return contradiction(c);
    }
  }
  for (const UnitId p : row.parents) {
    if (!index_.Has(p)) continue;
    if (!has(index_.children(p), unit) || index_.unit(p).round <= row.entry.round ||
        row.entry.error_code_max > index_.error_code_below(p)) {
      return contradiction(p);
    }
  }
  index_.Put(unit, row.entry, PackedLocation(row.offset, row.bytes, row.checksum), first_vertex,
             row.children, row.parents, row.error_code_below);
  return Status::Ok();
}

void PackedSource::Read(std::span<const UnitId> units, std::shared_ptr<PayloadReceiver> receiver) {
  std::vector<UnitId> order(units.begin(), units.end());
  std::ranges::sort(order, std::greater<>());  // coarse before fine
  std::vector<Part> wanted;
  std::vector<Delivery> deliveries;
  {
    const MutexLock lock(mutex_);
    for (const UnitId unit : order) {
      if (unit >= index_.unit_count()) {
        deliveries.push_back({receiver, unit,
                              InvalidArgument(place_ + ": no unit " + std::to_string(unit) +
                                              ", it has " + std::to_string(index_.unit_count()))});
        continue;
      }
      questions_.push_back(std::make_shared<Question>(Question{unit, receiver, false, false, {}}));
      Advance(QuestionPtr(questions_.back()), &wanted, &deliveries);
    }
  }
  Ask(std::move(wanted));
  Deliver(std::move(deliveries));
}

// Parts near each other make one request. What lies first is wanted first: the file is in the order
// of refining.
void PackedSource::Ask(std::vector<Part> wanted) {
  if (wanted.empty()) return;
  std::ranges::sort(wanted, {}, [](const Part& p) { return p.range.offset; });
  std::vector<RequestPtr> requests;
  for (Part& part : wanted) {
    const uint64_t end = part.range.offset + part.range.bytes;
    if (!requests.empty()) {
      Request& last = *requests.back();
      const uint64_t last_end = last.range.offset + last.range.bytes;
      if (!at_once_ && part.range.offset <= last_end + how_.gap_bytes &&
          end - last.range.offset <= how_.range_bytes) {
        last.range.bytes = std::max(end, last_end) - last.range.offset;
        last.parts.push_back(std::move(part));
        continue;
      }
    }
    requests.push_back(std::make_shared<Request>());
    requests.back()->range = part.range;
    requests.back()->parts.push_back(std::move(part));
  }
  {
    const MutexLock lock(mutex_);
    requests_.insert(requests_.end(), requests.begin(), requests.end());
  }
  for (const RequestPtr& request : requests) {
    const RangeReader::Ticket ticket = file_->ranges().Read(
        request->range, [weak = weak_from_this(), request](Result<Bytes> bytes) {
          if (const auto self = weak.lock()) self->Arrive(request, std::move(bytes));
        });
    const MutexLock lock(mutex_);
    request->ticket = ticket;
  }
}

void PackedSource::Fail(const Status& status, const Part& part, std::vector<Delivery>* deliveries) {
  const auto fail = [&](const QuestionPtr& q) {
    deliveries->push_back({q->receiver, q->unit, status});
  };
  if (part.question != nullptr) {
    if (std::ranges::find(questions_, part.question) == questions_.end()) return;
    fail(part.question);
    std::erase(questions_, part.question);
    return;
  }
  pages_[part.page] = PageState::kNone;
  std::erase_if(questions_, [&](const QuestionPtr& q) {
    const std::vector<uint32_t> missing = MissingPages(q->unit);
    if (std::ranges::find(missing, part.page) == missing.end()) return false;
    fail(q);
    return true;
  });
}

// On a thread of the file's, which no exception may leave.
void PackedSource::Arrive(const RequestPtr& request, Result<Bytes> bytes) {
  std::vector<Delivery> deliveries;
  const Status status = CatchOutOfMemory([&] {
    std::vector<Part> wanted;
    Take(request, std::move(bytes), &wanted, &deliveries);
    Ask(std::move(wanted));
    return Status::Ok();
  });
  Deliver(std::move(deliveries));
  if (!status.ok()) FailAll(status);
}

void PackedSource::Take(const RequestPtr& request, Result<Bytes> bytes, std::vector<Part>* wanted,
                        std::vector<Delivery>* deliveries) {
  const MutexLock lock(mutex_);
  std::erase(requests_, request);
  bool any_page = false;
  for (const Part& part : request->parts) {
    Status status = bytes.status();
    if (status.ok()) {
      const ByteSpan piece =
          ByteSpan(*bytes).subspan(part.range.offset - request->range.offset, part.range.bytes);
      bool again = false;
      status = TakePart(part, piece, &again);
      if (again) {
        wanted->push_back(part);
        wanted->back().again = true;
        continue;
      }
      any_page |= part.question == nullptr;
    }
    if (!status.ok()) Fail(status, part, deliveries);
  }
  // A page may be what any question waits for, a payload what its own does.
  const std::vector<QuestionPtr> open = questions_;
  for (const QuestionPtr& q : open) {
    if (any_page || q->there) Advance(q, wanted, deliveries);
  }
}

Status PackedSource::TakePart(const Part& part, ByteSpan bytes, bool* again) {
  const QuestionPtr& question = part.question;
  const Status status =
      question == nullptr ? PutPage(part.page, bytes) : CheckPayload(question->unit, bytes);
  if (status.code() == StatusCode::kCorrupt) {
    *again = file_->ranges().Forget(part.range) && !part.again;
  } else if (status.ok() && question != nullptr) {
    question->payload.assign(bytes.begin(), bytes.end());
    question->there = true;
  }
  return status;
}

void PackedSource::FailAll(const Status& status) {
  std::vector<QuestionPtr> failed;
  {
    const MutexLock lock(mutex_);
    failed.swap(questions_);
    // Pages that are under way may be asked for again; requests that never left are forgotten.
    std::ranges::replace(pages_, PageState::kAsked, PageState::kNone);
    std::erase_if(requests_, [](const RequestPtr& request) { return request->ticket == 0; });
  }
  for (const QuestionPtr& q : failed) q->receiver->Receive(q->unit, status);
}

void PackedSource::Deliver(std::vector<Delivery> deliveries) {
  for (Delivery& d : deliveries) d.receiver->Receive(d.unit, std::move(d.payload));
}

// Requests of which nobody wants anything any more are cancelled; pages stay wanted.
void PackedSource::Cancel(const PayloadReceiver& receiver) {
  std::vector<RangeReader::Ticket> tickets;
  {
    const MutexLock lock(mutex_);
    std::erase_if(questions_, [&](const QuestionPtr& q) { return q->receiver.get() == &receiver; });
    std::erase_if(requests_, [&](const RequestPtr& request) {
      const bool idle = std::ranges::all_of(request->parts, [&](const Part& part) {
        return part.question != nullptr &&
               std::ranges::find(questions_, part.question) == questions_.end();
      });
      if (idle && request->ticket != 0) tickets.push_back(request->ticket);
      return idle && request->ticket != 0;
    });
  }
  for (const RangeReader::Ticket ticket : tickets) file_->ranges().Cancel(ticket);
}

Result<Bytes> PackedSource::ReadTextureFile(uint32_t file, uint64_t offset, uint64_t bytes) {
  return CatchOutOfMemory([&]() -> Result<Bytes> {
    MTDB_RETURN_IF_ERROR(CheckFileRange(object_.record, file, offset, bytes, place_));
    if (bytes == 0) return Bytes();
    const ByteRange range{object_.texture_file(file) + offset, bytes};
    Bytes read;
    const Status status = ReadChecked(file_->ranges(), range, [&](Bytes came) {
      read = std::move(came);
      if (bytes < object_.record.texture->file(file).bytes) return Status::Ok();
      return CheckFileChecksum(object_.record, file, Hash64(read), place_);
    });
    if (status.ok()) return read;
    if (status.message().starts_with(place_)) return status;
    // The carrier's own message names the file.
    return Status(status.code(), status.message() + " (object " + object_.record.name + ": " +
                                     TextureFileLabel(object_.record, file) + ")");
  });
}

}  // namespace mtdb::internal
