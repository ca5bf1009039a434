// SPDX-License-Identifier: Apache-2.0
// PackedFile: a packed file that is open. PackedSource: one of its objects.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "store/base/threading.h"
#include "store/cluster_source.h"
#include "store/packed/packed_format.h"
#include "store/range_reader.h"

namespace mtdb::internal {

// Header and directory, read and checked. Immutable.
class PackedFile {
 public:
  // Errors: kCorrupt, kUnsupported, those of the reader.
  static Result<std::shared_ptr<PackedFile>> Open(std::shared_ptr<RangeReader> ranges);

  RangeReader& ranges() const { return *ranges_; }
  const PackedHeader& header() const { return header_; }
  const std::vector<PackedObject>& objects() const { return objects_; }
  // kNotFound.
  Result<const PackedObject*> Find(const std::string& name) const;

 private:
  explicit PackedFile(std::shared_ptr<RangeReader> ranges) : ranges_(std::move(ranges)) {}

  std::shared_ptr<RangeReader> ranges_;
  PackedHeader header_;
  std::vector<PackedObject> objects_;
};

// How parts of a file become requests. The defaults are measured: see
// docs/notes/2026-11-gap-between-ranges.md.
struct PackedRequests {
  // Parts that lie so near each other are asked for as one range, with what is between them,
  uint64_t gap_bytes = 16 << 10;
  // as long as the range has no more bytes than this: several requests are under way at once.
  uint64_t range_bytes = 256 << 10;
};

// Asks for pages as they are needed; or, when opened whole, has them all. See ClusterSource.
class PackedSource final : public ClusterSource, public std::enable_shared_from_this<PackedSource> {
 public:
  // With what the root's pieces and their children need; whole: with all rows.
  static Result<std::shared_ptr<ClusterSource>> Open(std::shared_ptr<PackedFile> file,
                                                     const PackedObject& object, bool whole,
                                                     const PackedRequests& requests = {});

  const ObjectRecord& record() const override { return object_.record; }
  const ClusterIndex& index() const override { return index_; }
  void Read(std::span<const UnitId> units, std::shared_ptr<PayloadReceiver> receiver) override;
  void Cancel(const PayloadReceiver& receiver) override;
  Result<Bytes> ReadTextureFile(uint32_t file, uint64_t offset, uint64_t bytes) override;
  bool answers_at_once() const override { return at_once_; }
  uint64_t bytes_read() const override { return file_->ranges().bytes_read(); }

 private:
  // A unit that was asked for and is not answered.
  struct Question {
    UnitId unit = 0;
    std::shared_ptr<PayloadReceiver> receiver;
    bool asked = false;  // for the payload
    bool there = false;
    Bytes payload;
  };
  using QuestionPtr = std::shared_ptr<Question>;
  enum class PageState : uint8_t { kNone, kAsked, kThere };
  // What a request gets: a page, or the payload of a question.
  struct Part {
    ByteRange range;
    uint32_t page = 0;
    QuestionPtr question;  // null: a page
    bool again = false;    // what came first was damaged, and a copy
  };
  struct Request {
    ByteRange range;
    std::vector<Part> parts;
    RangeReader::Ticket ticket = 0;
  };
  using RequestPtr = std::shared_ptr<Request>;
  struct Delivery {
    std::shared_ptr<PayloadReceiver> receiver;
    UnitId unit = 0;
    Result<Bytes> payload;
  };

  PackedSource(std::shared_ptr<PackedFile> file, const PackedObject& object, bool whole,
               const PackedRequests& how);
  Status ReadWholeIndex();
  Status ReadFirstRows();
  // Of rows that are there: that the root's vertices are in its pieces.
  Status CheckRoot() const;
  Status CheckPayload(UnitId unit, ByteSpan payload) const;
  Status ReadPage(uint32_t page);

  // With mutex_ held.
  // The pages that the question still needs, as far as one can tell now.
  std::vector<uint32_t> MissingPages(UnitId unit) const;
  void Advance(const QuestionPtr& question, std::vector<Part>* wanted,
               std::vector<Delivery>* deliveries);
  Status PutPage(uint32_t page, ByteSpan bytes);
  Status PutRow(UnitId unit, const PackedRow& row, VertexIndex first_vertex);
  // What has come of the part. `again`: it has to be asked for once more.
  Status TakePart(const Part& part, ByteSpan bytes, bool* again);
  void Fail(const Status& status, const Part& part, std::vector<Delivery>* deliveries);

  // Without.
  void Ask(std::vector<Part> wanted);
  void Arrive(const RequestPtr& request, Result<Bytes> bytes);
  void Take(const RequestPtr& request, Result<Bytes> bytes, std::vector<Part>* wanted,
            std::vector<Delivery>* deliveries);
  // Answers all that is asked with the error; takes no memory.
  void FailAll(const Status& status);
  static void Deliver(std::vector<Delivery> deliveries);

  const std::shared_ptr<PackedFile> file_;
  const PackedObject& object_;
  const std::string place_;
  const bool at_once_;
  const PackedRequests how_;
  Mutex mutex_;  // guards what follows, and putting rows
  ClusterIndex index_;
  std::vector<PageState> pages_;
  std::vector<QuestionPtr> questions_;
  std::vector<RequestPtr> requests_;  // under way
};

}  // namespace mtdb::internal
