// SPDX-License-Identifier: Apache-2.0
// Builds that are killed at every stage go on and end as if nothing had happened.
#include <catch2/catch.hpp>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "store/verify_store.h"
#include "tests/builder/fixture.h"
#include "tests/support/temporary_folder.h"

namespace mtdb::testing {

namespace {

// Where a test's store and journal lie.
struct Folder : TemporaryFolder {
  std::string store() const { return path() + "/a.mtdb"; }
  std::string journal() const { return path() + "/a.journal"; }
};

BuildOptions Options(const Folder& folder, bool resume) {
  BuildOptions options;
  options.tile_triangles = 512;
  options.threads = 2;
  options.tmp_directory = folder.path();
  options.journal_path = folder.journal();
  options.resume = resume;
  return options;
}

Result<ObjectRecord> BuildOnce(const Folder& folder, const TriangleMesh& mesh,
                               const BuildOptions& options, const ProgressCallback& progress = {}) {
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                        Database::Open(folder.store(), {.writable = true, .create = true}));
  return BuildInto(*database, "a", mesh, options, progress);
}

// Builds in a child process that is killed when its progress is reported for the `calls`-th time.
// False when the build ended before that.
bool BuildAndDie(const Folder& folder, const TriangleMesh& mesh, bool resume, int calls) {
  const pid_t child = fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    int left = calls;
    const auto record = BuildOnce(folder, mesh, Options(folder, resume), [&](const BuildProgress&) {
      if (--left == 0) raise(SIGKILL);
      return Status::Ok();
    });
    _exit(record.ok() ? 0 : 1);
  }
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
  if (WIFSIGNALED(status)) return true;
  REQUIRE(WEXITSTATUS(status) == 0);
  return false;
}

}  // namespace

TEST_CASE("A build killed at any stage goes on to the same object") {
  const TriangleMesh mesh = MakeSculpture(20000);
  const std::string expected = [&] {
    Folder folder;
    return BuildOnce(folder, mesh, Options(folder, false)).value().digest_hex();
  }();
  // Tiles of 512 make some 50 tiles: progress is reported at each stage and a few times a round.
  bool killed = true;
  for (int calls = 1; killed; calls += 2) {
    INFO("killed at report " << calls);
    Folder folder;
    killed = BuildAndDie(folder, mesh, false, calls);
    if (!killed) break;
    BuildAndDie(folder, mesh, true, 3);  // and once more, early
    const auto record = BuildOnce(folder, mesh, Options(folder, true));
    REQUIRE(record.ok());
    REQUIRE(record->digest_hex() == expected);
    REQUIRE_FALSE(std::filesystem::exists(folder.journal()));
    CheckReport report;
    REQUIRE(VerifyStore(folder.store(), "", &report).ok());
    REQUIRE(report.failures == std::vector<std::string>{});
  }
}

TEST_CASE("Going on does not decimate again what is done") {
  const TriangleMesh mesh = MakeSculpture(20000);
  Folder folder;
  REQUIRE(BuildAndDie(folder, mesh, false, 6));
  const auto before = std::filesystem::file_size(folder.journal());
  REQUIRE(before > 20000);
  uint64_t at_first_report = 0;
  const auto record = BuildOnce(folder, mesh, Options(folder, true), [&](const BuildProgress& p) {
    if (p.round != 0 && at_first_report == 0) {
      at_first_report = std::filesystem::file_size(folder.journal());
    }
    return Status::Ok();
  });
  REQUIRE(record.ok());
  // Nothing was appended while the finished tiles were replayed.
  REQUIRE(at_first_report <= before);
}

std::string ReadFile(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

// What a power failure, a disk or a stranger may do to a journal. `other` is another build's.
std::string Damaged(std::string journal, const std::string& other, int how,
                    std::mt19937_64& random) {
  constexpr size_t kBlock = 4096;
  const size_t at = random() % journal.size();
  const size_t blocks = journal.size() / kBlock;
  const auto block = [&](size_t i) { return journal.substr(i * kBlock, kBlock); };
  const size_t a = random() % blocks;
  const size_t b = random() % blocks;
  switch (how) {
    case 0: journal.resize(at); break;
    case 1: journal[std::max<size_t>(at, 16)] ^= static_cast<char>(1 << random() % 8); break;
    case 2: journal.replace(a * kBlock, kBlock, kBlock, '\0'); break;
    case 3: {  // two blocks change places
      const std::string kept = block(a);
      journal.replace(a * kBlock, kBlock, block(b));
      journal.replace(b * kBlock, kBlock, kept);
      break;
    }
    case 4: journal.replace(at, journal.npos, journal.size() - at, '\0'); break;
    case 5:  // the other one may end before
      journal.replace(a * kBlock, kBlock, other.substr(std::min(a * kBlock, other.size()), kBlock));
      break;
    case 6: journal.resize(at), journal += other.substr(std::min(at, other.size())); break;
    case 7: journal += journal.substr(at); break;  // records again
    case 8: journal.erase(a * kBlock, kBlock); break;
    default: journal.clear(); break;
  }
  return journal;
}

TEST_CASE("A damaged journal serves up to the damage, and never beyond") {
  const TriangleMesh mesh = MakeSculpture(20000);
  const std::string expected = [&] {
    Folder folder;
    return BuildOnce(folder, mesh, Options(folder, false)).value().digest_hex();
  }();
  Folder folder;
  // The other journal has the same header but for the input: records of one key are the same.
  REQUIRE(BuildAndDie(folder, MakeSculpture(20000, 2), false, 8));
  const std::string other = ReadFile(folder.journal());
  std::filesystem::remove(folder.journal());
  REQUIRE(BuildAndDie(folder, mesh, false, 8));
  const std::string whole = ReadFile(folder.journal());
  REQUIRE(whole.size() > 100000);
  std::mt19937_64 random(1);
  for (int round = 0; round < 40; ++round) {
    INFO("round " << round);
    Folder here;
    std::ofstream(here.journal(), std::ios::binary) << Damaged(whole, other, round % 10, random);
    const auto record = BuildOnce(here, mesh, Options(here, true));
    INFO(record.status().message());
    // The whole first block may be another build's.
    if (record.status().code() == StatusCode::kInvalidArgument) continue;
    REQUIRE(record.ok());
    REQUIRE(record->digest_hex() == expected);
  }
}

TEST_CASE("A journal of another input or other options is refused, and kept") {
  const TriangleMesh mesh = MakeSculpture(20000);
  Folder folder;
  REQUIRE(BuildAndDie(folder, mesh, false, 6));
  BuildOptions other = Options(folder, true);
  other.bits = 14;
  auto record = BuildOnce(folder, mesh, other);
  REQUIRE(record.status().code() == StatusCode::kInvalidArgument);
  REQUIRE(record.status().message().find("--resume") != std::string::npos);
  record = BuildOnce(folder, MakeSculpture(20000, 2), Options(folder, true));
  REQUIRE(record.status().code() == StatusCode::kInvalidArgument);
  REQUIRE(BuildOnce(folder, mesh, Options(folder, true)).ok());
}

TEST_CASE("A journal of a version that made other tiles is refused") {
  const TriangleMesh mesh = MakeSculpture(20000);
  Folder folder;
  REQUIRE(BuildAndDie(folder, mesh, false, 6));
  std::string journal = ReadFile(folder.journal());
  constexpr std::string_view kBefore = "mtdb journal 06";
  journal.replace(0, kBefore.size(), kBefore);
  std::ofstream(folder.journal(), std::ios::binary) << journal;
  const auto record = BuildOnce(folder, mesh, Options(folder, true));
  REQUIRE(record.status().code() == StatusCode::kInvalidArgument);
  REQUIRE(record.status().message().find("another version of mtdb") != std::string::npos);
}

TEST_CASE("A full disk stops the build, and it goes on when there is room") {
  const TriangleMesh mesh = MakeSculpture(20000);
  Folder folder;
  const pid_t child = fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    std::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{300000, 300000};  // bytes in any file
    setrlimit(RLIMIT_FSIZE, &limit);
    const auto record = BuildOnce(folder, mesh, Options(folder, false));
    _exit(record.status().code() == StatusCode::kNoSpace ? 7 : 1);
  }
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
  REQUIRE(WIFEXITED(status));
  REQUIRE(WEXITSTATUS(status) == 7);
  REQUIRE(BuildOnce(folder, mesh, Options(folder, true)).ok());
}

}  // namespace mtdb::testing
