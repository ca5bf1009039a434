// SPDX-License-Identifier: Apache-2.0
// Disks as a power failure may leave them, made from what tests/support/write_log.cc noted of a
// program. The model is the strictest that POSIX allows: only what was synced is certain. Of the
// rest each 4 KiB block of a write may be there or not, in any order; names (made, renamed,
// removed) are certain once their folder was synced, and get there in order.
#pragma once

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

namespace mtdb::testing {

struct WriteEvent {
  char kind = 0;  // C made, N made without a name, L linked to a name, W written, T cut, S file
                  // synced, D folder synced, R renamed, U removed
  uint64_t inode = 0;
  uint64_t at = 0;           // offset, or size
  bool synchronous = false;  // a write that is durable when it returns
  std::string path, other;   // C, D, L, U: path; R: from, to
  std::string data;
};

inline std::vector<WriteEvent> ReadWriteLog(const std::string& log) {
  std::ifstream in(log, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  size_t next = 0;
  const auto get = [&](auto* value) {
    if (bytes.size() - next < sizeof(*value)) throw std::runtime_error(log + ": cut short");
    std::memcpy(value, bytes.data() + next, sizeof(*value));
    next += sizeof(*value);
  };
  const auto text = [&](std::string* out, uint64_t size) {
    if (bytes.size() - next < size) throw std::runtime_error(log + ": cut short");
    *out = bytes.substr(next, size);
    next += size;
  };
  std::vector<WriteEvent> events;
  while (next < bytes.size()) {
    WriteEvent e;
    uint64_t flag = 0;
    uint32_t size = 0;
    uint64_t data = 0;
    get(&e.kind);
    get(&e.inode);
    get(&e.at);
    get(&flag);
    e.synchronous = flag != 0;
    get(&size);
    text(&e.path, size);
    get(&size);
    text(&e.other, size);
    get(&data);
    text(&e.data, data);
    events.push_back(std::move(e));
  }
  return events;
}

// What is certain, and what else may be there, after events one by one.
class DiskModel {
 public:
  void Apply(const WriteEvent& e) {
    switch (e.kind) {
      case 'W':
        if (e.synchronous) {
          Write(&files_[e.inode].certain, e);
        } else {
          files_[e.inode].pending.push_back(e);
        }
        break;
      case 'T': files_[e.inode].pending.push_back(e); break;
      case 'S': {
        File& file = files_[e.inode];
        for (const WriteEvent& w : file.pending) Write(&file.certain, w);
        file.pending.clear();
        break;
      }
      case 'D': {
        std::vector<WriteEvent> rest;
        for (WriteEvent& n : pending_names_) {
          if (Folder(n.path) == e.path) {
            Name(&names_, n);
          } else {
            rest.push_back(std::move(n));
          }
        }
        pending_names_ = std::move(rest);
        break;
      }
      default:  // an inode number that comes again is another file
        if (e.kind == 'C' || e.kind == 'N') files_[e.inode] = {};
        if (e.kind != 'N') pending_names_.push_back(e);
    }
  }

  // Makes the files of such a disk in `target`, which has what was in `folder`. Without `random`
  // nothing that is uncertain is there.
  void Make(const std::string& folder, const std::string& target, std::mt19937_64* random) const {
    std::map<std::string, uint64_t> names = names_;
    const size_t kept = random == nullptr ? 0 : (*random)() % (pending_names_.size() + 1);
    for (size_t i = 0; i < kept; ++i) Name(&names, pending_names_[i]);
    std::filesystem::remove_all(target);
    std::filesystem::create_directories(target);
    for (const auto& [path, inode] : names) {
      const auto file = files_.find(inode);
      if (file == files_.end()) continue;
      std::string bytes = file->second.certain;
      if (random != nullptr) {
        for (const WriteEvent& w : file->second.pending) WriteSome(&bytes, w, *random);
      }
      const std::string to = target + path.substr(folder.size());
      std::filesystem::create_directories(Folder(to));
      std::ofstream(to, std::ios::binary) << bytes;
    }
  }

 private:
  struct File {
    std::string certain;
    std::vector<WriteEvent> pending;
  };

  static std::string Folder(const std::string& path) { return path.substr(0, path.rfind('/')); }

  static void Write(std::string* bytes, const WriteEvent& e) {
    if (e.kind == 'T') {
      bytes->resize(e.at);
      return;
    }
    if (bytes->size() < e.at + e.data.size()) bytes->resize(e.at + e.data.size());
    bytes->replace(e.at, e.data.size(), e.data);
  }

  static void WriteSome(std::string* bytes, const WriteEvent& e, std::mt19937_64& random) {
    constexpr uint64_t kBlock = 4096;
    if (e.kind == 'T') {
      if (random() % 2 == 0) Write(bytes, e);
      return;
    }
    for (uint64_t begin = 0; begin < e.data.size();) {
      const uint64_t size =
          std::min<uint64_t>(e.data.size() - begin, kBlock - (e.at + begin) % kBlock);
      if (random() % 2 == 0) {
        WriteEvent part;
        part.kind = 'W';
        part.at = e.at + begin;
        part.data = e.data.substr(begin, size);
        Write(bytes, part);
      }
      begin += size;
    }
  }

  static void Name(std::map<std::string, uint64_t>* names, const WriteEvent& e) {
    if (e.kind == 'C' || e.kind == 'L') (*names)[e.path] = e.inode;
    if (e.kind == 'U') names->erase(e.path);
    if (e.kind != 'R') return;
    const auto from = names->find(e.path);
    if (from == names->end()) return;
    (*names)[e.other] = from->second;
    names->erase(e.path);
  }

  std::map<uint64_t, File> files_;  // by inode
  std::map<std::string, uint64_t> names_;
  std::vector<WriteEvent> pending_names_;
};

}  // namespace mtdb::testing
