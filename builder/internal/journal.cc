#include "builder/internal/journal.h"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "store/base/hash.h"

namespace mtdb {

namespace {

constexpr char kMagic[16] = "mtdb journal 01";
constexpr uint64_t kHeaderBytes = sizeof(kMagic) + 8;
constexpr uint64_t kRecordHeaderBytes = 12;  // u32 length, u64 checksum
constexpr uint32_t kMaxRecordBytes = 1u << 30;
constexpr uint64_t kSyncBytes = uint64_t{64} << 20;

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
  for (const uint64_t n : {o.locked_vertices, o.stuck_topology, o.stuck_degree}) w.PutVarint(n);
  w.PutVarint(c.encoded.children.size());
  for (const ClusterId child : c.encoded.children) w.PutVarint(child.value);
  w.PutVarint(c.encoded.payload.size());
  w.PutBytes(c.encoded.payload);
  w.PutVarint(c.left.triangles.size());
  w.PutBytes(std::as_bytes(std::span(c.left.triangles)));
  w.PutVarint(c.left.rows.size());
  w.PutBytes(c.left.rows);
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
  for (uint64_t* n : {&o->locked_vertices, &o->stuck_topology, &o->stuck_degree}) {
    *n = r.GetVarint();
  }
  const uint64_t children = r.GetVarint();
  if (children > r.remaining()) return false;
  for (uint64_t i = 0; i < children; ++i) {
    c.encoded.children.push_back(ClusterId(static_cast<uint32_t>(r.GetVarint())));
  }
  const ByteSpan payload = r.GetBytes(r.GetVarint());
  c.encoded.payload.assign(payload.begin(), payload.end());
  const uint64_t triangles = r.GetVarint();
  if (triangles > r.remaining() / sizeof(TileTriangle)) return false;
  const ByteSpan raw = r.GetBytes(triangles * sizeof(TileTriangle));
  c.left.triangles.resize(triangles);
  std::memcpy(c.left.triangles.data(), raw.data(), raw.size());
  const ByteSpan rows = r.GetBytes(r.GetVarint());
  c.left.rows.assign(rows.begin(), rows.end());
  return !r.failed() && r.remaining() == 0;
}

bool ReadAt(int file, uint64_t at, void* data, size_t size) {
  size_t done = 0;
  while (done < size) {
    const ssize_t n = pread(file, static_cast<std::byte*>(data) + done, size - done,
                            static_cast<off_t>(at + done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    done += static_cast<size_t>(n);
  }
  return true;
}

}  // namespace

Result<std::unique_ptr<Journal>> Journal::Open(const std::string& path, uint64_t fingerprint,
                                               bool resume) {
  const int file = open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  std::unique_ptr<Journal> journal(new Journal(file, path));
  if (file < 0) return journal->Error("cannot be made", errno);
  if (flock(file, LOCK_EX | LOCK_NB) != 0) {
    return Status(StatusCode::kBusy, path + ": another process builds this object; wait for it");
  }
  struct stat info;
  if (fstat(file, &info) != 0) return journal->Error("cannot be examined", errno);
  char header[kHeaderBytes];
  std::memcpy(header, kMagic, sizeof(kMagic));
  std::memcpy(header + sizeof(kMagic), &fingerprint, sizeof(fingerprint));
  const auto size = static_cast<uint64_t>(info.st_size);
  if (resume && size >= kHeaderBytes) {
    char found[kHeaderBytes];
    if (!ReadAt(file, 0, found, kHeaderBytes)) return journal->Error("cannot be read", EIO);
    if (std::memcmp(found, header, kHeaderBytes) != 0) {
      return InvalidArgument(path +
                             ": the interrupted build had another input or other options; "
                             "repeat them, or begin anew without --resume");
    }
    journal->size_ = size;
  } else {
    if (ftruncate(file, 0) != 0) return journal->Error("cannot be emptied", errno);
    MTDB_RETURN_IF_ERROR(journal->Write(std::as_bytes(std::span(header))));
    journal->size_ = kHeaderBytes;
  }
  journal->at_ = kHeaderBytes;
  return journal;
}

Journal::~Journal() {
  if (file_ >= 0) close(file_);
}

Status Journal::Error(const char* what, int error) const {
  const bool full = error == ENOSPC || error == EDQUOT || error == EFBIG;
  return Status(full ? StatusCode::kNoSpace : StatusCode::kIoError,
                path_ + ": journal " + what + ": " + std::strerror(error) +
                    (full ? "; free some space, then go on with --resume" : ""));
}

Result<std::optional<TileOutcome>> Journal::Next() {
  if (!reading_) return std::optional<TileOutcome>();
  uint32_t length = 0;
  uint64_t checksum = 0;
  std::byte header[kRecordHeaderBytes];
  if (size_ - at_ >= kRecordHeaderBytes && ReadAt(file_, at_, header, kRecordHeaderBytes)) {
    std::memcpy(&length, header, sizeof(length));
    std::memcpy(&checksum, header + sizeof(length), sizeof(checksum));
    if (length <= kMaxRecordBytes && size_ - at_ - kRecordHeaderBytes >= length) {
      Bytes bytes(length);
      std::optional<TileOutcome> outcome(std::in_place);
      if (ReadAt(file_, at_ + kRecordHeaderBytes, bytes.data(), length) &&
          Hash64(bytes, sequence_) == checksum && GetOutcome(bytes, &*outcome)) {
        at_ += kRecordHeaderBytes + length;
        ++sequence_;
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
  MTDB_CHECK(body.size() <= kMaxRecordBytes, "a tile's result is larger than a record may be");
  ByteWriter record;
  record.Put(static_cast<uint32_t>(body.size()));
  record.Put(Hash64(body.bytes(), sequence_++));
  record.PutBytes(body.bytes());
  return Write(record.bytes());
}

Status Journal::Write(ByteSpan bytes) {
  size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t n =
        pwrite(file_, bytes.data() + done, bytes.size() - done, static_cast<off_t>(at_ + done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return Error("cannot be written", n == 0 ? EIO : errno);
    done += static_cast<size_t>(n);
  }
  at_ += done;
  unsynced_ += done;
  if (unsynced_ >= kSyncBytes) {
    if (fdatasync(file_) != 0) return Error("cannot be written", errno);
    unsynced_ = 0;
  }
  return Status::Ok();
}

void Journal::Remove() { unlink(path_.c_str()); }

}  // namespace mtdb
