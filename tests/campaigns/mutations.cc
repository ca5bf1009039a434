// SPDX-License-Identifier: Apache-2.0
// Damages stores at random, and holds what readers and `verify` say of each damaged copy against
// what is true:
//
// - an answer is the undamaged store's, or an error;
// - when verify finds nothing, everything can be read and is what it was;
// - nothing crashes or hangs: each copy is looked at by a child process, whose end is watched.
//
//     mutations COUNT SEED STORE...
//
// tests/campaigns/mutations builds it with AddressSanitizer, makes stores of every kind and runs
// it.
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <map>
#include <random>
#include <string>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

#include "query/surface.h"
#include "query/verify_object.h"
#include "store/base/hash.h"
#include "store/database.h"
#include "store/verify_store.h"
#include "tests/support/temporary_folder.h"

namespace mtdb::testing {
namespace {

constexpr unsigned kSecondsForOne = 120;
constexpr size_t kPageBytes = 4096;

// Object and question -> a hash of the answer. What cannot be read is not there.
using Answers = std::map<std::string, uint64_t>;

uint64_t HashOf(const TriangleMesh& mesh) {
  uint64_t hash = Hash64(std::as_bytes(std::span(mesh.positions)), 1);
  hash = Hash64(std::as_bytes(std::span(mesh.triangles)), hash);
  return Hash64(mesh.rows, hash);
}

void AskObject(const Database& database, const std::string& name, Answers* answers) {
  auto source = database.OpenObject(name);
  if (!source.ok()) return;
  (*answers)[name + ": record"] = Hash64(EncodeObjectRecord((*source)->record()), 0);
  auto surface = Surface::Open(*source);
  if (!surface.ok()) return;
  const Box3d bounds = (*surface)->record().bounds;
  const double size = Length(bounds.max - bounds.min);
  std::vector<std::pair<std::string, Query>> questions(3);
  questions[0].first = "full";
  questions[1].first = "coarse";
  questions[1].second.threshold = ConstantThreshold(0.01 * size);
  questions[2].first = "corner";
  questions[2].second.region = SphereRegion(bounds.min, 0.4 * size);
  for (const auto& [what, query] : questions) {
    TriangleMesh mesh;
    TriangleMeshSink sink(&mesh);
    if ((*surface)->Extract(query, sink).ok()) (*answers)[name + ": " + what] = HashOf(mesh);
  }
}

Answers Ask(const std::string& path, const std::vector<std::string>& names) {
  Answers answers;
  const auto database = Database::Open(path);
  if (!database.ok()) return answers;
  const auto objects = (*database)->List();
  if (objects.ok()) {
    std::string list;
    for (const ObjectRecord& object : *objects) list += object.name + "\n";
    answers["list"] = Hash64(std::as_bytes(std::span(list)), 0);
  }
  for (const std::string& name : names) AskObject(**database, name, &answers);
  return answers;
}

// No failure found, and all could be looked at.
bool VerifyFindsNothing(const std::string& path, const std::vector<std::string>& names) {
  CheckReport report;
  if (!VerifyStore(path, "", &report).ok() || !report.ok()) return false;
  const auto database = Database::Open(path);
  if (!database.ok()) return false;
  for (const std::string& name : names) {
    auto source = (*database)->OpenObject(name);
    if (!source.ok()) return false;
    const auto surface = Surface::Open(*source);
    if (!surface.ok()) return false;
    for (const VerifyLevel level : {VerifyLevel::kFull, VerifyLevel::kGlobal}) {
      if (!VerifyObject(**surface, level, &report).ok() || !report.ok()) return false;
    }
  }
  return true;
}

// A damaged copy of `bytes`, and what was done.
std::string Damage(std::string& bytes, std::mt19937_64& random) {
  const auto below = [&](size_t n) { return static_cast<size_t>(random() % n); };
  const size_t pages = bytes.size() / kPageBytes;
  const size_t at = below(bytes.size());
  const size_t page = below(pages) * kPageBytes;
  switch (below(8)) {
    case 0:
    case 1:
      bytes[at] = static_cast<char>(bytes[at] ^ (1 << below(8)));
      return "a bit flipped at " + std::to_string(at);
    case 2: {
      const size_t header = page + below(16);
      bytes[header] = static_cast<char>(random());
      return "a byte of a page's header at " + std::to_string(header);
    }
    case 3: {
      const size_t length = std::min(1 + below(64), bytes.size() - at);
      for (size_t i = 0; i < length; ++i) bytes[at + i] = static_cast<char>(random());
      return std::to_string(length) + " random bytes at " + std::to_string(at);
    }
    case 4: {
      const size_t sector = at / 512 * 512;
      bytes.replace(sector, 512, std::min<size_t>(512, bytes.size() - sector), '\0');
      return "a sector of zeros at " + std::to_string(sector);
    }
    case 5: {
      const size_t other = below(pages) * kPageBytes;
      std::swap_ranges(bytes.begin() + page, bytes.begin() + page + kPageBytes,
                       bytes.begin() + other);
      return "pages swapped at " + std::to_string(page) + " and " + std::to_string(other);
    }
    case 6: {
      const size_t other = below(pages) * kPageBytes;
      bytes.replace(page, kPageBytes, bytes.substr(other, kPageBytes));
      return "page " + std::to_string(other) + " copied to " + std::to_string(page);
    }
    default: bytes.resize(at); return "cut off at " + std::to_string(at);
  }
}

struct Original {
  std::string path, bytes;
  std::vector<std::string> names;
  Answers answers;
};

Original Read(const std::string& path) {
  Original original;
  original.path = path;
  std::ifstream file(path, std::ios::binary);
  original.bytes.assign(std::istreambuf_iterator<char>(file), {});
  const auto database = Database::Open(path);
  const auto objects = database.ok() ? (*database)->List() : database.status();
  if (!objects.ok()) {
    std::fprintf(stderr, "%s\n", objects.status().message().c_str());
    std::exit(2);
  }
  for (const ObjectRecord& object : *objects) original.names.push_back(object.name);
  original.answers = Ask(path, original.names);
  if (!VerifyFindsNothing(path, original.names)) {
    std::fprintf(stderr, "%s: damaged to begin with\n", path.c_str());
    std::exit(2);
  }
  return original;
}

// What the child tells its parent.
struct Progress {
  uint64_t next;      // the copy that it looks at, or will
  uint64_t noticed;   // by verify
  uint64_t harmless;  // verify finds nothing, and nothing is different
  uint64_t wrong;
  char what[300];
};

// Looks at the copies from progress->next on.
void Look(const std::vector<Original>& originals, uint64_t count, uint64_t seed,
          const std::string& copy, Progress* progress) {
  for (; progress->next < count; ++progress->next) {
    alarm(kSecondsForOne);
    std::mt19937_64 random(seed + 0x9e3779b97f4a7c15u * progress->next);
    const Original& original = originals[random() % originals.size()];
    std::string bytes = original.bytes;
    const std::string what = original.path + ": " + Damage(bytes, random);
    std::snprintf(progress->what, sizeof progress->what, "%s", what.c_str());
    unlink(copy.c_str());
    std::ofstream(copy, std::ios::binary) << bytes;
    const bool nothing_found = VerifyFindsNothing(copy, original.names);
    const Answers answers = Ask(copy, original.names);
    const auto wrong = [&](const std::string& fault) {
      ++progress->wrong;
      std::printf("WRONG %llu: %s: %s\n", static_cast<unsigned long long>(progress->next),
                  what.c_str(), fault.c_str());
      std::fflush(stdout);
    };
    for (const auto& [question, hash] : answers) {
      if (hash != original.answers.at(question)) wrong(question + ": another answer");
    }
    if (nothing_found && answers.size() != original.answers.size()) {
      wrong("not all can be read, and verify finds nothing");
    }
    ++(nothing_found ? progress->harmless : progress->noticed);
  }
}

int Run(uint64_t count, uint64_t seed, const std::vector<std::string>& paths) {
  std::vector<Original> originals;
  for (const std::string& path : paths) originals.push_back(Read(path));
  const TemporaryFolder folder;
  auto* progress = static_cast<Progress*>(
      mmap(nullptr, sizeof(Progress), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0));
  if (progress == MAP_FAILED) return 2;
  while (progress->next < count) {
    const pid_t child = fork();
    if (child < 0) return 2;
    if (child == 0) {
      Look(originals, count, seed, folder.path() + "/copy.mtdb", progress);
      _exit(0);
    }
    int status = 0;
    waitpid(child, &status, 0);
    if (status == 0) continue;
    std::printf("WRONG %llu: %s: the process ended with %s %d\n",
                static_cast<unsigned long long>(progress->next), progress->what,
                WIFSIGNALED(status) ? "signal" : "status",
                WIFSIGNALED(status) ? WTERMSIG(status) : WEXITSTATUS(status));
    ++progress->wrong;
    ++progress->next;
  }
  std::printf(
      "%llu damaged stores: %llu noticed by verify, %llu damaged in dead bytes only, %llu wrong\n",
      static_cast<unsigned long long>(count), static_cast<unsigned long long>(progress->noticed),
      static_cast<unsigned long long>(progress->harmless),
      static_cast<unsigned long long>(progress->wrong));
  return progress->wrong == 0 ? 0 : 1;
}

}  // namespace
}  // namespace mtdb::testing

int main(int argc, char** argv) {
  if (argc < 4) {
    std::fprintf(stderr, "usage: mutations COUNT SEED STORE...\n");
    return 2;
  }
  return mtdb::testing::Run(std::strtoull(argv[1], nullptr, 10),
                            std::strtoull(argv[2], nullptr, 10), {argv + 3, argv + argc});
}
