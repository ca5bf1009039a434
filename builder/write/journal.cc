// SPDX-License-Identifier: Apache-2.0
#include "builder/write/journal.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <fcntl.h>
#include <string_view>
#include <sys/file.h>
#include <sys/stat.h>
#include <thread>
#include <unistd.h>
#include <utility>

#include "builder/disk/squeeze.h"
#include "store/base/hash.h"
#include "store/files/guarded_file.h"
#include "store/files/posix_file.h"

namespace mtdb::internal {

namespace {

// The header: magic, the mark, u64 checksum of what follows, the key, u32 length of the note, the
// note. The magic's number changes with the records, and with what the builder or the codecs make
// of a tile.
constexpr char kMagic[16] = "mtdb journal 13";
// The mark: zeros, or the object's digest, hash of its name, hash of these and the checksum.
constexpr size_t kMarkBytes = 32;
constexpr size_t kFixedHeaderBytes = sizeof(kMagic) + kMarkBytes + 8 + 16 + 4;
constexpr size_t kMaxNoteBytes = 64 << 10;
constexpr size_t kTriangleWords = sizeof(TileTriangle) / sizeof(uint32_t);
constexpr size_t kMostTableBytes = size_t{1} << 31;
constexpr uint64_t kRecordHeaderBytes = 16;  // u64 length, u64 checksum
constexpr uint64_t kSyncBytes = uint64_t{64} << 20;
// Who only looks at a journal holds its lock for a moment.
constexpr int kLockAttempts = 100;
constexpr std::chrono::milliseconds kLockPause{5};

struct Header {
  JournalKey key;
  std::string note;
  Bytes mark;
  uint64_t checksum = 0;
  uint64_t bytes = 0;  // of the header
};

Bytes MarkOf(const ObjectRecord& record, uint64_t checksum) {
  ByteWriter w;
  w.Put(record.digest_low);
  w.Put(record.digest_high);
  w.Put(Hash64(AsBytes(record.name)));
  w.Put(Hash64(w.bytes(), checksum));
  return Bytes(w.bytes().begin(), w.bytes().end());
}

// Whether the path still leads to this file.
bool IsAt(int file, const std::string& path) {
  struct stat here;
  struct stat there;
  return fstat(file, &here) == 0 && lstat(path.c_str(), &there) == 0 &&
         here.st_dev == there.st_dev && here.st_ino == there.st_ino;
}

void PutOutcome(const TileOutcome& o, ByteWriter& w) {
  const TileCluster& c = o.cluster;
  w.Put<uint8_t>(c.empty);
  w.Put<uint8_t>(c.entry.round);
  w.Put(c.entry.hilbert);
  for (int i = 0; i < 3; ++i) w.Put(c.entry.bounds.min[i]);
  for (int i = 0; i < 3; ++i) w.Put(c.entry.bounds.max[i]);
  for (const uint32_t n : {c.entry.nodes, c.entry.in_triangles, c.entry.out_triangles,
                           c.entry.external_vertices, c.height, c.max_degree}) {
    w.PutVarint(n);
  }
  w.Put(c.entry.error_code_min);
  w.Put(c.entry.error_code_max);
  w.Put<uint8_t>(c.entry.explicit_arcs);
  for (const uint64_t n : {o.locked_vertices, o.seam_vertices, o.stuck_topology, o.stuck_degree,
                           o.vanished_components, o.vanished_border_loops}) {
    w.PutVarint(n);
  }
  w.PutVarint(c.encoded.children.size());
  for (const UnitId child : c.encoded.children) w.PutVarint(child);
  w.PutVarint(c.encoded.payload.size());
  w.PutBytes(c.encoded.payload);
  const Bytes left = SqueezeTable(std::as_bytes(std::span(c.left.triangles)), kTriangleWords);
  w.PutVarint(left.size());
  w.PutBytes(left);
  const Bytes rows = SqueezeTable(c.left.rows, 0);
  w.PutVarint(rows.size());
  w.PutBytes(rows);
  w.PutVarint(c.surface.size());
  w.PutBytes(c.surface);
}

// False when the bytes are not an outcome.
bool GetOutcome(ByteSpan bytes, TileOutcome* o) {
  ByteReader r(bytes);
  TileCluster& c = o->cluster;
  c.empty = r.Get<uint8_t>() != 0;
  c.entry.round = r.Get<uint8_t>();
  c.entry.hilbert = r.Get<uint64_t>();
  for (int i = 0; i < 3; ++i) c.entry.bounds.min[i] = r.Get<int32_t>();
  for (int i = 0; i < 3; ++i) c.entry.bounds.max[i] = r.Get<int32_t>();
  for (uint32_t* n : {&c.entry.nodes, &c.entry.in_triangles, &c.entry.out_triangles,
                      &c.entry.external_vertices, &c.height, &c.max_degree}) {
    *n = static_cast<uint32_t>(r.GetVarint());
  }
  c.entry.error_code_min = r.Get<uint8_t>();
  c.entry.error_code_max = r.Get<uint8_t>();
  c.entry.explicit_arcs = r.Get<uint8_t>() != 0;
  for (uint64_t* n : {&o->locked_vertices, &o->seam_vertices, &o->stuck_topology, &o->stuck_degree,
                      &o->vanished_components, &o->vanished_border_loops}) {
    *n = r.GetVarint();
  }
  const uint64_t children = r.GetVarint();
  if (children > r.remaining()) return false;
  for (uint64_t i = 0; i < children; ++i) {
    c.encoded.children.push_back(static_cast<UnitId>(r.GetVarint()));
  }
  const ByteSpan payload = r.GetBytes(r.GetVarint());
  c.encoded.payload.assign(payload.begin(), payload.end());
  const std::optional<Bytes> left =
      UnsqueezeTable(r.GetBytes(r.GetVarint()), kTriangleWords, kMostTableBytes);
  if (!left) return false;
  c.left.triangles.resize(left->size() / sizeof(TileTriangle));
  if (!left->empty()) std::memcpy(c.left.triangles.data(), left->data(), left->size());
  std::optional<Bytes> rows = UnsqueezeTable(r.GetBytes(r.GetVarint()), 0, kMostTableBytes);
  if (!rows) return false;
  c.left.rows = *std::move(rows);
  const ByteSpan surface = r.GetBytes(r.GetVarint());
  c.surface.assign(surface.begin(), surface.end());
  return !r.failed() && r.remaining() == 0;
}

enum class Found { kHeader, kNothingWhole, kOtherVersion, kUnreadable };

// Reads the header; `*error` is errno when the file is unreadable.
Found ReadHeader(int file, Header* header, int* error) {
  Bytes bytes(kFixedHeaderBytes + kMaxNoteBytes);
  const ssize_t n = ReadFully(file, 0, bytes.data(), bytes.size());
  if (n < 0) {
    *error = errno;
    return Found::kUnreadable;
  }
  bytes.resize(static_cast<size_t>(n));
  ByteReader r(bytes);
  const ByteSpan magic = r.GetBytes(sizeof(kMagic));
  const ByteSpan mark = r.GetBytes(kMarkBytes);
  header->mark.assign(mark.begin(), mark.end());
  header->checksum = r.Get<uint64_t>();
  if (r.failed()) return Found::kNothingWhole;
  const size_t hashed = r.position();
  if (std::memcmp(magic.data(), kMagic, sizeof(kMagic)) != 0) {
    return AsString(magic).starts_with("mtdb journal ") ? Found::kOtherVersion
                                                        : Found::kNothingWhole;
  }
  header->key.options = r.Get<uint64_t>();
  header->key.input = r.Get<uint64_t>();
  header->note = AsString(r.GetBytes(r.Get<uint32_t>()));
  header->bytes = r.position();
  if (r.failed() ||
      Hash64(ByteSpan(bytes).subspan(hashed, header->bytes - hashed)) != header->checksum) {
    return Found::kNothingWhole;
  }
  return Found::kHeader;
}

// All but whether it is in use.
Result<JournalInfo> Examine(int file, const std::string& path,
                            std::span<const ObjectRecord> published) {
  JournalInfo journal;
  struct stat info;
  Header header;
  int error = 0;
  const bool examined = fstat(file, &info) == 0;
  const Found found =
      examined && S_ISREG(info.st_mode) ? ReadHeader(file, &header, &error) : Found::kNothingWhole;
  if (found == Found::kUnreadable) return IoError(path + ": " + std::strerror(error));
  journal.bytes = examined ? static_cast<uint64_t>(info.st_size) : 0;
  journal.note = std::move(header.note);
  journal.usable = found == Found::kHeader;
  journal.finished = journal.usable && std::ranges::any_of(published, [&](const ObjectRecord& r) {
                       return header.mark == MarkOf(r, header.checksum);
                     });
  return journal;
}

}  // namespace

Result<std::unique_ptr<Journal>> Journal::Open(const BuildOptions& options, const JournalKey& key,
                                               const SpoolSpace* space) {
  const std::string& path = options.journal_path;
  // The folder may be open to all: a link or a file of somebody else's is not followed or believed.
  const GuardedFile there = RecogniseFileAt(path);
  if (there != GuardedFile::kJournal) MTDB_RETURN_IF_ERROR(RefuseToReplace(there, path));
  std::unique_ptr<Journal> journal(new Journal(path, space));
  MTDB_RETURN_IF_ERROR(journal->Lock());
  const int file = journal->file_;
  struct stat info;
  if (fstat(file, &info) != 0) return journal->Error("cannot be examined", errno);
  if (!S_ISREG(info.st_mode) || info.st_uid != geteuid()) {
    return IoError(path + ": is no journal of yours; remove it, or choose another folder");
  }
  if (options.resume && info.st_size > 0) {
    Header header;
    int error = 0;
    const auto refuse = [&](const char* difference) {
      return InvalidArgument(path + ": the interrupted build had " + difference +
                             "; repeat it as it was, or begin anew without --resume");
    };
    switch (ReadHeader(file, &header, &error)) {
      case Found::kUnreadable: return journal->Error("cannot be read", error);
      case Found::kOtherVersion: return refuse("another version of mtdb");
      case Found::kNothingWhole: break;
      case Found::kHeader:
        if (header.key.options != key.options) return refuse("other options");
        if (header.key.input != key.input) {
          return refuse("another input (or the same files in another order)");
        }
        journal->size_ = static_cast<uint64_t>(info.st_size);
        journal->at_ = header.bytes;
        journal->chain_ = journal->checksum_ = header.checksum;
        return journal;
    }
  }
  const Status begun = journal->Begin(key, options.journal_note);
  if (!begun.ok()) {
    (void)unlink(path.c_str());  // there is nothing in it to go on with
    return begun;
  }
  return journal;
}

Status Journal::Lock() {
  for (int attempt = 0;; ++attempt) {
    file_ = open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0600);
    if (file_ < 0) return Error("cannot be made", errno);
    if (flock(file_, LOCK_EX | LOCK_NB) == 0) {
      // Who had it may have removed it since it was opened here.
      if (IsAt(file_, path_)) return CheckContent();
    } else if (errno != EWOULDBLOCK) {
      return Error("cannot be locked", errno);
    }
    close(std::exchange(file_, -1));
    if (attempt == kLockAttempts) {
      return Status(StatusCode::kBusy, path_ + ": another process builds this object; wait for it");
    }
    std::this_thread::sleep_for(kLockPause);
  }
}

// What is no journal is not emptied for one. A journal that a power failure cut short may begin
// with zeros.
Status Journal::CheckContent() const {
  constexpr size_t kLookedAt = 96;  // a binary STL has its count before that
  std::array<char, kLookedAt> bytes;
  const ssize_t n = ReadFully(file_, 0, bytes.data(), bytes.size());
  if (n <= 0) return Status::Ok();
  const std::string_view start(bytes.data(), static_cast<size_t>(n));
  constexpr std::string_view kWord = "mtdb journal ";
  const bool is_journal = start.substr(0, kWord.size()) == kWord.substr(0, start.size());
  if (is_journal || start.find_first_not_of('\0') == start.npos) return Status::Ok();
  return {StatusCode::kAlreadyExists,
          path_ +
              ": is no journal of an ingest; nothing was written: give another name for the "
              "journal, or remove that file first"};
}

Status Journal::Begin(const JournalKey& key, const std::string& note) {
  if (ftruncate(file_, 0) != 0) return Error("cannot be emptied", errno);
  const std::string kept = note.substr(0, kMaxNoteBytes);
  ByteWriter body;
  body.Put(key.options);
  body.Put(key.input);
  body.Put(static_cast<uint32_t>(kept.size()));
  body.PutBytes(AsBytes(kept));
  chain_ = Hash64(body.bytes());
  ByteWriter header;
  header.PutBytes(std::as_bytes(std::span(kMagic)));
  header.PutBytes(Bytes(kMarkBytes));
  header.Put(chain_);
  header.PutBytes(body.bytes());
  MTDB_RETURN_IF_ERROR(Write(header.bytes()));
  checksum_ = chain_;
  size_ = at_;
  MTDB_RETURN_IF_ERROR(Sync());
  // The name too, else a power failure takes the file with it.
  const size_t slash = path_.rfind('/');
  const std::string folder = slash == std::string::npos ? "." : path_.substr(0, slash + 1);
  const int directory = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (directory < 0) return Status::Ok();  // a folder that may be written to only
  const bool synced = fsync(directory) == 0 || errno == EINVAL;
  const int error = errno;
  close(directory);
  return synced ? Status::Ok() : Error("cannot be written", error);
}

Journal::~Journal() {
  if (file_ >= 0) close(file_);
}

Status Journal::Error(const char* what, int error) const {
  const StatusCode code = FileErrorCode(error);
  const bool full = code == StatusCode::kNoSpace;
  return Status(code, path_ + ": journal " + what + ": " + std::strerror(error) +
                          (full ? "; free some space, then go on with --resume" : ""));
}

Result<std::optional<TileOutcome>> Journal::Next() {
  if (!reading_) return std::optional<TileOutcome>();
  std::byte header[kRecordHeaderBytes];
  if (size_ - at_ >= kRecordHeaderBytes) {
    const ssize_t n = ReadFully(file_, at_, header, kRecordHeaderBytes);
    if (n < 0) return Error("cannot be read", errno);
    uint64_t length = 0;
    uint64_t checksum = 0;
    std::memcpy(&length, header, sizeof(length));
    std::memcpy(&checksum, header + sizeof(length), sizeof(checksum));
    if (n == kRecordHeaderBytes && length <= size_ - at_ - kRecordHeaderBytes) {
      Bytes bytes(length);
      const ssize_t m = ReadFully(file_, at_ + kRecordHeaderBytes, bytes.data(), length);
      if (m < 0) return Error("cannot be read", errno);
      std::optional<TileOutcome> outcome(std::in_place);
      if (static_cast<uint64_t>(m) == length && Hash64(bytes, chain_) == checksum &&
          GetOutcome(bytes, &*outcome)) {
        at_ += kRecordHeaderBytes + length;
        chain_ = checksum;
        return outcome;
      }
    }
  }
  // The end, or a record that was being written when the build was interrupted.
  reading_ = false;
  if (ftruncate(file_, static_cast<off_t>(at_)) != 0) return Error("cannot be cut", errno);
  return std::optional<TileOutcome>();
}

Status Journal::Append(const TileOutcome& outcome) {
  MTDB_CHECK(!reading_, "a journal is read to its end before it is continued");
  ByteWriter body;
  PutOutcome(outcome, body);
  chain_ = Hash64(body.bytes(), chain_);
  ByteWriter header;
  header.Put(uint64_t{body.size()});
  header.Put(chain_);
  MTDB_RETURN_IF_ERROR(Write(header.bytes()));
  MTDB_RETURN_IF_ERROR(Write(body.bytes()));
  return space_->Take(at_ - std::exchange(counted_, at_));
}

Status Journal::Write(ByteSpan bytes) {
  if (!WriteFully(file_, at_, bytes.data(), bytes.size())) return Error("cannot be written", errno);
  at_ += bytes.size();
  unsynced_ += bytes.size();
  return unsynced_ >= kSyncBytes ? Sync() : Status::Ok();
}

Status Journal::Sync() {
  if (fdatasync(file_) != 0) return Error("cannot be written", errno);
  unsynced_ = 0;
  return Status::Ok();
}

Status Journal::Finish(const ObjectRecord& record) {
  const Bytes mark = MarkOf(record, checksum_);
  const uint64_t end = std::exchange(at_, sizeof(kMagic));
  const Status written = Write(mark);
  at_ = end;
  MTDB_RETURN_IF_ERROR(written);
  return Sync();
}

void Journal::Remove() {
  if (IsAt(file_, path_)) unlink(path_.c_str());
}

}  // namespace mtdb::internal

namespace mtdb {

Result<JournalInfo> ReadJournalInfo(const std::string& path,
                                    std::span<const ObjectRecord> published) {
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
  if (file < 0) {
    const int error = errno;
    const std::string what = path + ": " + std::strerror(error);
    return error == ENOENT ? NotFound(what) : IoError(what);
  }
  Result<JournalInfo> journal = internal::Examine(file, path, published);
  if (journal.ok()) journal->in_use = flock(file, LOCK_SH | LOCK_NB) != 0;
  close(file);
  return journal;
}

void RemoveFinishedJournal(const std::string& path, std::span<const ObjectRecord> published) {
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
  if (file < 0) return;
  if (flock(file, LOCK_EX | LOCK_NB) == 0) {
    const Result<JournalInfo> journal = internal::Examine(file, path, published);
    const bool useless = journal.ok() && (journal->finished || journal->bytes == 0);
    if (useless && internal::IsAt(file, path)) unlink(path.c_str());
  }
  close(file);
}

}  // namespace mtdb
